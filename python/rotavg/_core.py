"""The C++ core, in the fastest build that this processor runs.

The builds differ in their instructions, so that results can differ in the last bits from one kind
of processor to another (never from one number of threads to another). The environment variable
ROTAVG_CORE asks for one of them: "baseline", which runs anywhere and which wheels hold as well, or
"avx2".
"""

import os
from typing import Any

_HOW = "install it anew: the wheel, or in the sources pip install . (in a clone ./dev setup)"
_wanted = os.environ.get("ROTAVG_CORE", "")

if _wanted not in ("", "baseline", "avx2"):
    raise ImportError(f"found ROTAVG_CORE={_wanted}, expected baseline, avx2, or none at all")
try:
    from rotavg._processor import runs_avx2_core

    _runs_avx2 = runs_avx2_core()
    if _runs_avx2 and _wanted != "baseline":
        from rotavg._core_avx2 import *  # noqa: F403
        from rotavg._core_avx2 import __version__ as __version__
    else:
        from rotavg._core_baseline import *  # noqa: F403
        from rotavg._core_baseline import __version__ as __version__
except ImportError as error:
    raise ImportError(
        f"the compiled core of rotavg cannot be imported ({error}); {_HOW}", name=__name__
    ) from error

if _wanted == "avx2" and not _runs_avx2:
    raise ImportError("found ROTAVG_CORE=avx2, which this processor does not run", name=__name__)


def __getattr__(name: str) -> Any:
    if name.startswith("_"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    # No AttributeError: `from rotavg._core import name` would hide what it says.
    raise ImportError(
        f"the compiled core of rotavg has no {name!r}: it is older than the Python package; {_HOW}",
        name=__name__,
    )
