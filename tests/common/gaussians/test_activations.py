import numpy as np
import pytest

from readygo.common.gaussians.activations import (
    SCALE_MIN_M,
    logits_from_opacities,
    logs_from_scales,
    opacities_from_logits,
    scales_from_logs,
)


def test_stored_and_physical_numbers_are_inverse_in_any_shape():
    opacities = np.float32([[0.01, 0.3], [0.7, 0.99]])
    np.testing.assert_allclose(opacities_from_logits(logits_from_opacities(opacities)), opacities, rtol=1e-6)
    scales_m = np.float32([[1e-6, 0.02, 5.0]])
    np.testing.assert_allclose(scales_from_logs(logs_from_scales(scales_m)), scales_m, rtol=1e-5)


def test_numbers_are_rounded_once_from_double_precision():
    x = np.linspace(-8, 3, 200, dtype=np.float32)
    np.testing.assert_array_equal(scales_from_logs(x), np.exp(x.astype(np.float64)).astype(np.float32))
    logistic = 1.0 / (1.0 + np.exp(-x.astype(np.float64)))
    np.testing.assert_allclose(opacities_from_logits(x), logistic, rtol=1e-7)


@pytest.mark.parametrize(("opacity", "logit"), [(0.0, -40.0), (-0.5, -40.0), (1.0, 40.0), (1.5, 40.0), (0.5, 0.0)])
def test_opacities_without_a_logit_take_the_limit(opacity, logit):
    assert logits_from_opacities(np.float32([opacity])).tolist() == [logit]


def test_what_is_too_large_or_too_small_stays_a_number_that_can_be_told():
    assert scales_from_logs(np.float32([1000.0])).tolist() == [np.inf]
    assert opacities_from_logits(np.float32([-1000.0, 1000.0])).tolist() == pytest.approx([0.0, 1.0], abs=1e-16)
    np.testing.assert_allclose(logs_from_scales(np.float32([0.0])), [np.log(SCALE_MIN_M)], rtol=1e-6)
    assert np.isnan(scales_from_logs(np.float32([np.nan]))).all()


def test_slices_that_are_not_contiguous_are_taken():
    table = np.float32([[0.0, 9.0], [1.0, 9.0]])
    np.testing.assert_allclose(scales_from_logs(table[:, 0]), [1.0, np.e], rtol=1e-6)
