# %% [markdown]
# # A model with a contact: its response curve
# A rod of 60 dofs as a finite element program would give it, driven at one end. The other end
# touches a stop. It is reduced first; then the steady state is followed over the frequency.

# %%
import numpy as np

import modald

client = modald.local()

# %%
n = 60
K = 3600.0 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
K[-1, -1] = 3600.0              # the free end
M = np.eye(n) / n
# files: modald.scene.matrix_market("K.mtx"), modald.scene.calculix("b.sti", "b.mas", "b.dof")

# %%
model = modald.scene.craig_bampton(M, K, keep=["x1", f"x{n}"], modes=8)
print(model.dofs, np.round(model.frequencies[:3], 3))

# %%
first = np.sqrt(np.linalg.eigvalsh(K * n)[0])
scene = {"structure": model.structure, "omega": first,
         "effects": [{"type": "rayleigh_damping", "alpha": 0.02 * first, "beta": 0.0},
                     {"type": "gap", "dof": f"x{n}", "stiffness": 20.0, "clearance": 0.05}],
         "excitation": [{"dof": "x1", "k": 1, "cos": 10.0}]}
alone = {**scene, "effects": scene["effects"][:1]}

# %%
curve = client.steady(scene, {"continue": f"omega={0.9 * first}:{1.2 * first}"})
linear = client.steady(alone, {"continue": f"omega={0.9 * first}:{1.2 * first}"})
curve


# %% [markdown]
# The stop stiffens: the peak moves to higher frequencies.

# %%
def peak(result):
    rows = result.rows()
    return max(rows, key=lambda row: row[f"x{n}"])["omega"] / first


print(f"largest at {peak(linear):.3f} of the first frequency without the stop, "
      f"{peak(curve):.3f} with it")

# %%
client.close()
