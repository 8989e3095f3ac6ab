# %% [markdown]
# # A running simulation
# Its motion is sent to modald while it goes on, by a call in the loop that never waits; windows are
# identified beside it, and the loop can ask whether the motion is stable.

# %%
import os
import time

import numpy as np

import modald

client = modald.local()
os.environ["MODALD_URL"] = client.endpoint      # without it every call of a stream does nothing
os.environ["MODALD_CLOSE_WAIT"] = "60"          # s that the end may wait until all has arrived

# %% [markdown]
# The loop: a mode of 2.3 Hz whose damping ratio is 0.5 %.

# %%
dt, zeta, w = 0.01, 0.005, 2 * np.pi * 2.3
with modald.stream("rig7", ["tip"], dt, window=1000, hop=500) as stream:
    for step in range(2000):
        t = step * dt
        stream.push([np.exp(-zeta * w * t) * np.cos(w * np.sqrt(1 - zeta**2) * t)])
    deadline = time.monotonic() + 60            # a simulation would go on; this one is too fast
    while stream.verdict == "unknown" and time.monotonic() < deadline:
        time.sleep(0.01)

# %% [markdown]
# What was known at the end stays known.

# %%
print(stream.verdict, f"{stream.estimate.frequency_hz:.4f} Hz, "
      f"damping ratio {stream.estimate.damping_ratio:.5f}")

# %% [markdown]
# Each window's modes are events, which can be had later too.

# %%
for event in client.events(start=1, stream="rig7", timeout=60):
    if event.header.get("modes"):
        print(event["to"], [round(mode["frequency_hz"], 4) for mode in event["modes"]])
        break

# %%
client.close()
