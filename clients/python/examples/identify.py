# %% [markdown]
# # Modes of a recording
# A structure was struck; three sensors recorded how it rings down. What are its frequencies, how
# fast does each mode decay, and how well does the recording tell?

# %%
import numpy as np

import modald

client = modald.local()         # a daemon of one's own; modald.connect() is the lab's

# %% [markdown]
# Any file that modald reads is `modald.read(path)`. Here the recording is made: two modes, 2.3 Hz
# with a damping ratio of 0.5 %, 4.1 Hz with 0.2 %, and noise of 1 %.

# %%
dt, rng = 0.01, np.random.default_rng(1)
t = np.arange(3000) * dt
y = np.zeros((len(t), 3))
for f, zeta, shape in ((2.3, 0.005, (0.3, 0.7, 1.0)), (4.1, 0.002, (1.0, -0.4, -0.6))):
    w = 2 * np.pi * f
    y += np.outer(np.exp(-zeta * w * t) * np.cos(w * np.sqrt(1 - zeta**2) * t), shape)
y += 0.01 * rng.standard_normal(y.shape)
recording = modald.Batch(y, dt, names=["root", "mid", "tip"])

# %%
result = client.identify(recording, options={"shapes": True})
result

# %% [markdown]
# Each number has its standard error, the verdict is one on the error bars, and shapes are complex,
# their largest component 1.

# %%
for f, sf, z, sz in zip(result.frequency_hz, result.std_frequency_hz, result.damping_ratio,
                        result.std_damping_ratio):
    print(f"{f:.5f} Hz +- {sf:.1e}, damping ratio {z:.6f} +- {sz:.1e}")
print("stable" if result["stability"]["stable"] else "not known to be stable")
print(np.round(result.shapes.real, 2))

# %% [markdown]
# Many recordings are identified beside each other; the results come in their order.

# %%
halves = [modald.Batch(y[:1500], dt), modald.Batch(y[1500:], dt)]
for half in client.map(halves, rank_fixed=4):
    print(np.sort(half.frequency_hz))

# %%
client.close()
