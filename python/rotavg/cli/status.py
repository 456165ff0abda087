"""Exit statuses that are not those of errors."""

from __future__ import annotations

INTERRUPTED = 130  # 128 + SIGINT, as shells have it
