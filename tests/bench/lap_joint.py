"""A lap joint: two plates of hexahedra that overlap on a patch of SIDE x SIDE contacts, three dofs
each, as sparse matrices and a scene.

Plates of 2 (SIDE - 1) by SIDE - 1 by 2 cubes of side 1 / (SIDE - 1), trilinear, eight Gauss points:
the lower is clamped at its far end and the upper, which contacts alone hold across and along,
rests on springs of a thousandth of them, so that its stiffness is regular.  A pressure
on its outer faces holds the patch together, that of the contacts where nothing has moved; the upper
one's free end is shaken along the plates.  Past mu PRESSURE = 0.003 the whole patch slides.
"""
import numpy as np
import scipy.sparse as sp

YOUNG, POISSON, DENSITY, PRESSURE = 1.0, 0.3, 1.0, 0.01
CORNERS = np.array([[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)])


def hexahedron(side):
    """Stiffness and mass of a cube, nodes as CORNERS, dofs x, y, z of each."""
    lame = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
    shear = YOUNG / (2 * (1 + POISSON))
    elastic = np.diag([2 * shear] * 3 + [shear] * 3)
    elastic[:3, :3] += lame
    sign, K, M = 2 * CORNERS - 1, np.zeros((24, 24)), np.zeros((24, 24))
    for gauss in sign / np.sqrt(3):
        factor = (1 + sign * gauss) / 2
        shape = factor.prod(axis=1)
        slope = np.array([sign[:, a] / 2 * factor[:, (a + 1) % 3] * factor[:, (a + 2) % 3]
                          for a in range(3)]) * 2 / side
        strain, motion = np.zeros((6, 24)), np.zeros((3, 24))
        for a in range(3):
            strain[a, a::3] = slope[a]
            motion[a, a::3] = shape
            for b, row in ((1, 3 + a), (2, 3 + (a + 2) % 3)):
                strain[row, a::3] += slope[(a + b) % 3]
        K += strain.T @ elastic @ strain * (side / 2) ** 3
        M += DENSITY * motion.T @ motion * (side / 2) ** 3
    return K, M


def plate(shape, side):
    """Stiffness, mass and the numbers of nodes [x, y, z] of SHAPE elements."""
    number = np.arange(np.prod(np.array(shape) + 1)).reshape(np.array(shape) + 1)
    cells = np.stack([number[i:i + shape[0], j:j + shape[1], k:k + shape[2]].ravel()
                      for i, j, k in CORNERS], axis=1)
    dofs = (3 * cells[:, :, None] + np.arange(3)).reshape(len(cells), 24)
    row, column = np.repeat(dofs, 24, axis=1).ravel(), np.tile(dofs, (1, 24)).ravel()
    return (*[sp.coo_matrix((np.tile(of.ravel(), len(cells)), (row, column))).tocsr()
              for of in hexahedron(side)], number)


def lap_joint(patch, harmonics=21, omega=0.12, load=0.0025, mu=0.3):
    """K, M, C and the scene but for its structure's matrices; loads and patch have one area."""
    side = 1 / (patch - 1)
    K, M, number = plate((2 * (patch - 1), patch - 1, 2), side)
    n = K.shape[0]
    lower = np.setdiff1d(np.arange(n), 3 * number[-1].ravel()[:, None] + np.arange(3))
    K, M = [sp.block_diag([of, of[lower][:, lower]]).tocsr() for of in (K, M)]
    place = np.full(n, -1)
    place[lower] = n + np.arange(len(lower))
    upper_face, lower_face = number[-patch:, :, 0].ravel(), number[:patch, :, -1].ravel()
    area = side ** 2
    weak = np.zeros(K.shape[0])
    weak[:n] = 1e-3 * area
    K = K + sp.diags(weak)
    top, bottom = 3 * number[-patch:, :, -1].ravel() + 2, 3 * number[:patch, :, 0].ravel() + 2
    free, name = 3 * number[0].ravel(), lambda dof: f"x{dof + 1}"
    pressure = PRESSURE * area
    excitation = [{"dof": name(d), "k": 0, "cos": -pressure} for d in top]
    excitation += [{"dof": name(place[d]), "k": 0, "cos": pressure} for d in bottom]
    excitation += [{"dof": name(d), "k": 1, "cos": load / len(free)} for d in free]
    nodes = [{"normal": {name(place[3 * b + 2]): 1, name(3 * a + 2): -1},
              "tangential": [{name(3 * a + t): 1, name(place[3 * b + t]): -1} for t in (0, 1)],
              "area": area} for a, b in zip(upper_face, lower_face)]
    bed = {"type": "contact_bed", "nodes": nodes, "normal_stiffness": 10.0,
           "tangential_stiffness": 5.0, "preload": PRESSURE, "mu": mu}
    return K, M, (0.02 * M + 0.01 * K).tocsr(), {
        "effects": [bed], "omega": omega, "excitation": excitation,
        "steady": {"harmonics": harmonics, "stability": False, "dofs": [name(free[0])]}}
