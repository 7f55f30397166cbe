"""The identification experiment that a rig states in [protocol]."""

from dataclasses import dataclass

from maglev_env.fields import is_number
from maglev_env.rig.excitation import Excitation, check_interleaved


@dataclass(frozen=True)
class Protocol:
    """The rig's identification experiment.

    Args:
        excitations: with the same fundamental and different lines.
        periods: number of recorded periods, at least 2.
        transient_periods: number of periods before them, which are not recorded.
        band_width: width of the estimation bands, Hz.
        band_overlap: overlap of neighbouring bands, Hz.

    Raises:
        ValueError: A value is not valid; the message names it.
    """

    excitations: tuple[Excitation, ...]
    periods: int = 5
    transient_periods: int = 1
    band_width: float = 15.0
    band_overlap: float = 12.0

    def __post_init__(self) -> None:
        check_interleaved(self.excitations)
        for name in ("periods", "transient_periods"):
            if type(getattr(self, name)) is not int:
                raise ValueError(f"[protocol]: {name} = {getattr(self, name)!r} must be a whole number")
        for name in ("band_width", "band_overlap"):
            if not is_number(getattr(self, name)):
                raise ValueError(f"[protocol]: {name} = {getattr(self, name)!r} is not a finite number")
        if self.periods < 2 or self.transient_periods < 0:
            raise ValueError("[protocol]: periods must be at least 2 and transient_periods at least 0")
        if not 0 <= self.band_overlap < self.band_width:
            raise ValueError("[protocol]: band_overlap must be at least 0 and smaller than band_width")
