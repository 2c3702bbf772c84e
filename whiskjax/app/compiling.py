"""Whether JAX is compiling right now, by the events with which it measures itself."""

from collections.abc import Callable
from types import TracebackType

# A function is traced, lowered to this form, and then compiled (or fetched from the cache); each event ends its step.
_LOWERED = "/jax/core/compile/jaxpr_to_mlir_module_duration"
_COMPILED = "/jax/core/compile/backend_compile_duration"


class Compiling:
    """Within the `with` block, `is_now` says whether a function is being compiled.

    **Arguments:** `changed`: called where that changes.
    """

    def __init__(self, changed: Callable[[], None]):
        self.is_now = False
        self._changed = changed

    def _hear(self, event: str, duration_secs: float, **_: object) -> None:
        if event in (_LOWERED, _COMPILED):
            self.is_now = event == _LOWERED
            self._changed()

    def __enter__(self) -> "Compiling":
        import jax.monitoring

        jax.monitoring.register_event_duration_secs_listener(self._hear)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        import jax.monitoring

        jax.monitoring.unregister_event_duration_listener(self._hear)
