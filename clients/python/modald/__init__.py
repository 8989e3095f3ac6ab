"""modald: frequencies, damping, stability and steady vibration, as a service.

    import modald
    with modald.connect() as c:                 # or modald.local(): a daemon of one's own
        result = c.identify(signals, dt, options={"rank.fixed": 6})
        print(result.frequency_hz, result.damping_ratio, result.std_damping_ratio)

One client serves any number of threads; its jobs are futures (`submit`, `map`, `as_completed`).
Documents are those of proto/PROTOCOL.md and modald-result(5), as dictionaries; numpy arrays and
scipy.sparse matrices are taken wherever numbers are.  Every failure is a `modald.Error` with the
protocol's stable code.
"""
from . import scene
from .client import Client, Event, connect
from .daemon import local
from .estimator import Identify
from .files import read
from .inputs import Batch
from .jobs import Job, as_completed
from .link import Error
from .results import Result
from .streaming import Stream, close_all, stream

__all__ = ["Batch", "Client", "Error", "Event", "Identify", "Job", "Result", "Stream",
           "as_completed", "close_all", "connect", "local", "read", "scene", "stream"]
__version__ = "0.1.0"
