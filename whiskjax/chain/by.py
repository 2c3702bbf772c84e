"""One link, or one camera, for each swing, view, strip or image."""

import functools
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from ..algebra.vectors import Component
from ..rules import RESULTS, Arrays, WhiskjaxError, need
from ..rules.results import choose
from .camera import AbstractCamera
from .chosen_camera import chosen_camera
from .link import AbstractLink, Moves, Recorded
from .pose import Pose
from .shot import KEYS, Shot


class By(AbstractLink):
    """Options told apart by a key of the shot: `By("swing", {"left": Mount(...), "right": Mount(...)})`.

    The shot's key is the index of the option, in the order given. Where the key is a Python int the option is chosen before
    tracing; where it is an array every option is evaluated and selected element by element.
    """

    key: str = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    options: tuple[Any, ...]

    def __init__(self, key: str, options: Mapping[str, Any]):
        """**Arguments:** the key ("image", "swing", "view" or "strip") and the options by name: links, or cameras."""
        if key not in KEYS:
            raise WhiskjaxError(f"options are told apart by one of {', '.join(KEYS)}, not {key!r}")
        need("By", "options", options, Mapping, 'a dict of links or cameras by name, as {"left": Mount(...)}')
        if not options:
            raise WhiskjaxError(f"By({key!r}) needs at least one option")
        for name, option in options.items():
            need("By", f"options[{name!r}]", option, (AbstractLink, AbstractCamera))
        if len({is_camera(option) for option in options.values()}) > 1:
            raise WhiskjaxError(f"By({key!r}): its options are links or cameras, not some of each")
        self.key, self.names, self.options = key, tuple(options), tuple(options.values())

    def __getitem__(self, name: str) -> Any:
        """The option of this name."""
        if name not in self.names:
            raise WhiskjaxError(f"no {self.key} named {name!r}; there are {', '.join(self.names)}")
        return self.options[self.names.index(name)]

    def _key_of(self, shot: Shot) -> Any:
        value = shot.need(self.key, f"which tells {' and '.join(self.names)} apart")
        if isinstance(value, int) and not 0 <= value < len(self.options):
            raise WhiskjaxError(
                f"{self.key} {value} does not exist; there are 0 to {len(self.options) - 1} ({', '.join(self.names)})"
            )
        return value

    @property
    def is_line(self) -> bool:
        """Whether the options are cameras of lines."""
        return self.options[0].is_line

    def chosen(self, shot: Shot) -> Any:
        """The one option that acts where all shots share the key, else this link itself."""
        key = self._key_of(shot)
        return self.options[key].chosen(shot) if isinstance(key, int) else self

    @property
    def recorded(self) -> tuple[Recorded, ...]:
        """The series of all options."""
        return tuple(record for option in self.options for record in option.recorded)

    @property
    def is_timed(self) -> bool:
        """Whether one of the options changes with time."""
        return any(option.is_timed for option in self.options)

    def moves(self, shot: Shot) -> Moves:
        """As the option of all shots, or as any of them: the samples of all, and the fastest."""
        key = self._key_of(shot)
        chosen = self.options if not isinstance(key, int) else self.options[key : key + 1]
        of_each = [option.moves(shot) for option in chosen]
        return Moves(
            tuple(record for moves in of_each for record in moves.recorded),
            functools.reduce(jnp.maximum, [moves.turn_radps for moves in of_each]),
            functools.reduce(jnp.maximum, [moves.speed_mps for moves in of_each]),
        )

    def pose(self, shot: Shot) -> Pose:
        """The pose of the option of each shot."""
        key = self._key_of(shot)
        if isinstance(key, int):
            return self.options[key].pose(shot)
        return _select(key, [option.pose(shot) for option in self.options])

    def at(self, shot: Shot) -> Any:
        """The camera of each shot, where the options are cameras."""
        key = self._key_of(shot)
        if isinstance(key, int):
            return self.options[key].at(shot)
        return chosen_camera(key, tuple(option.at(shot) for option in self.options))

    def check(self, shot: Shot) -> RESULTS:
        """Whether the key exists, and the option's own check."""
        key = self._key_of(shot)
        if isinstance(key, int):
            return self.options[key].check(shot)
        result = RESULTS.unknown_key
        for i, option in enumerate(self.options):
            result = choose(key == i, option.check(shot), result)
        return result


def is_camera(part: Any) -> bool:
    """Whether this is a camera, or several told apart by a key."""
    return is_camera(part.options[0]) if isinstance(part, By) else isinstance(part, AbstractCamera)


def is_aligned(part: Any) -> bool:
    """Whether a link or camera, or an option of it, holds numbers for each shot."""
    return any(map(is_aligned, part.options)) if isinstance(part, By) else part.batch_shape != ()


def fit(arrays: Arrays, name: str, part: Any, shot: Shot) -> None:
    """Whether what a link or camera holds for each shot fits the other arguments of somebody; options that do not act need not.

    **Raises:** `WhiskjaxError` naming the link.
    """
    if not isinstance(part, By):
        arrays.fit(f"sensor[{name!r}]", part.batch_shape, "...")
        return
    key = getattr(shot, part.key)
    for option in part.options[key : key + 1] if isinstance(key, int) and key >= 0 else part.options:
        fit(arrays, name, option, shot)


def _select(key: Any, choices: list[Pose]) -> Pose:
    """The pose of each element, component by component; what is the same structural number in all of them stays structural."""

    def pick(*leaves: Component) -> Component:
        if all(type(leaf) is int for leaf in leaves) and len(set(leaves)) == 1:
            return leaves[0]
        value = leaves[-1]
        for i, leaf in reversed(list(enumerate(leaves[:-1]))):
            value = jnp.where(key == i, leaf, value)
        return value

    return jax.tree.map(pick, *choices)
