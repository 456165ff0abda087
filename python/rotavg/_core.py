"""The C++ core, in the fastest build that this processor runs.

The builds differ in their instructions, so that results can differ in the last bits from one kind
of processor to another (never from one number of threads to another). ROTAVG_CORE=baseline asks for
the build that runs anywhere, which a wheel holds as well (./dev builds what this processor runs).
"""

import os
from typing import Any

_HOW = "build it anew: pip install . in the sources (in a clone ./dev setup)"

try:
    from rotavg._processor import runs_avx2_core

    if runs_avx2_core() and os.environ.get("ROTAVG_CORE") != "baseline":
        from rotavg._core_avx2 import *  # noqa: F403
        from rotavg._core_avx2 import __version__ as __version__
    else:
        from rotavg._core_baseline import *  # noqa: F403
        from rotavg._core_baseline import __version__ as __version__
except ImportError as error:
    raise ImportError(
        f"the compiled core of rotavg cannot be imported ({error}); {_HOW}", name=__name__
    ) from error


def __getattr__(name: str) -> Any:
    if name.startswith("_"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    # No AttributeError: `from rotavg._core import name` would hide what it says.
    raise ImportError(
        f"the compiled core of rotavg has no {name!r}: it is older than the Python package; {_HOW}",
        name=__name__,
    )
