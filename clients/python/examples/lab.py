# %% [markdown]
# # A service for many
# What a daemon is doing, for whom, and what it keeps, as who runs it would look at it from a
# notebook. `modald.connect(endpoint, keyfile)` is the lab's; an admin sees everybody's.

# %%
import numpy as np

import modald

client = modald.local()
who = client.whoami()
print(who["user"], who["role"])

# %% [markdown]
# Some work: twenty records, each under a key of its own. The same key again is the same job, so a
# loop that was broken off is simply run again.

# %%
t = np.arange(400) * 0.01
jobs = [client.submit("identify", modald.Batch(np.exp(-0.1 * t) * np.cos((10 + i) * t), 0.01),
                      key=f"demo:{i}") for i in range(20)]
again = client.submit("identify", modald.Batch(np.exp(-0.1 * t) * np.cos(10 * t), 0.01),
                      key="demo:0")
print(again.id == jobs[0].id)

# %% [markdown]
# Results as they come, in any order.

# %%
found = [job.result()["modes"][0]["frequency_hz"] for job in modald.as_completed(jobs)]
print(len(found), f"{min(found):.4f} to {max(found):.4f} Hz")

# %% [markdown]
# Counts and sizes; the same as Prometheus text is `client.metrics()`.

# %%
stats = client.stats()
print("done", stats["jobs"]["done"], "queued", stats["jobs"]["queued"],
      "disk full" if stats["storage_full"] else "disk good")

# %% [markdown]
# Streams, live and recent; each record that was closed is a batch by its name.

# %%
for stream in client.streams():
    print(stream["name"], stream["user"], stream["state"], stream["samples"])

# %% [markdown]
# What went wrong is `client.list(state="failed")`.

# %%
print("failed", len(list(client.list(state="failed"))))

# %%
client.close()
