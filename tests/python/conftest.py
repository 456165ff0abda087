"""What all tests stand on."""

import signal

# Shells have their background jobs ignore Ctrl-C, and all that these start. The tests press it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
