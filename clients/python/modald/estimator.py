"""Identification in the shape of scikit-learn's estimators: parameters, fit, what was learned."""
from __future__ import annotations

from typing import Any

import numpy.typing as npt

from .client import Client, connect, options_of
from .inputs import Batch
from .results import Complex, Floats, Result


class Identify:
    """`Identify(rank_fixed=6).fit(y, dt).frequency_hz_`: modes of signals as an estimator.

    Parameters are identify's options, a dot written as an underscore (`modalctl identify --help`),
    and `client`: None is the daemon of `modald.connect()`; `modald.local()` needs none to run.
    """

    result_: Result
    frequency_hz_: Floats
    damping_ratio_: Floats
    std_frequency_hz_: Floats
    std_damping_ratio_: Floats
    exponent_: Complex
    multiplier_: Complex

    def __init__(self, client: Client | None = None, **options: Any):
        """Nothing is asked before `fit`."""
        self.client, self.options = client, options

    def __repr__(self) -> str:
        """As it was made."""
        return f"Identify({', '.join(f'{k}={v!r}' for k, v in self.options.items())})"

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """The parameters, by name; `deep` changes nothing, for none has parameters of its own."""
        return {"client": self.client, **self.options}

    def set_params(self, **params: Any) -> "Identify":
        """Change some of them; gives itself."""
        self.client = params.pop("client", self.client)
        self.options.update(params)
        return self

    def fit(self, y: npt.ArrayLike | Batch, dt: float | None = None,
            period: float | None = None) -> "Identify":
        """Identify `y`, shape (samples,) or (samples, channels), at steps of `dt` s; `period` [s]
        of a periodic system.

        Gives itself, with `result_` and its arrays of shape (modes,): `frequency_hz_` [Hz],
        `damping_ratio_`, `std_frequency_hz_` [Hz], `std_damping_ratio_`, `exponent_` [1/s],
        `multiplier_`.
        """
        options = options_of(self.options)
        if self.client is not None:
            self.result_ = self.client.identify(y, dt, options, period=period)
        else:
            with connect() as client:
                self.result_ = client.identify(y, dt, options, period=period)
        for name in ("frequency_hz", "damping_ratio", "std_frequency_hz", "std_damping_ratio",
                     "exponent", "multiplier"):
            setattr(self, name + "_", getattr(self.result_, name))
        return self
