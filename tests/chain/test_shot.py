"""What identifies an exposure."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj


def test_times_become_float64_and_keys_become_indices():
    shot = wj.Shot(time_s=[1, 2], image=np.array([0, 1]), swing=np.int64(1), view=0)
    assert shot.time_s.dtype == jnp.float64
    assert shot.image.dtype == jnp.int32
    # A key that the whole batch shares is chosen before tracing.
    assert type(shot.swing) is int and type(shot.view) is int
    assert shot.strip is None


def test_a_shot_can_be_batched_by_vmap_and_jit():
    shot = wj.Shot(time_s=np.arange(3.0), image=np.arange(3), swing=1)
    by_time = jax.jit(jax.vmap(lambda time, image: wj.Shot(time, image, 1)))(shot.time_s, shot.image)
    np.testing.assert_array_equal(by_time.time_s, shot.time_s)
    np.testing.assert_array_equal(jax.jit(lambda s: s.time_s[s.image])(shot), shot.time_s)


@pytest.mark.parametrize("key", [0.5, np.array([0.0, 1.7])])
def test_a_key_that_is_no_index_is_refused(key):
    """Rounding it would name another image without saying so."""
    with pytest.raises(wj.WhiskjaxError, match="image"):
        wj.Shot(image=key)
