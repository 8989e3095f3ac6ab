"""modald: frequencies, damping, stability and steady vibration, as a service.

    import modald
    with modald.connect() as c:
        result = c.identify(signals, dt, options={"rank.fixed": 6})
        for mode in result["modes"]:
            print(mode["frequency_hz"], mode["damping_ratio"])

One client serves any number of threads.  Documents are those of proto/PROTOCOL.md, as dictionaries;
every failure is a `modald.Error` with the protocol's stable code.
"""
from .client import Batch, Client, Error, Event, Job, connect
from .streaming import Stream, stream

__all__ = ["Batch", "Client", "Error", "Event", "Job", "Stream", "connect", "stream"]
__version__ = "0.1.0"
