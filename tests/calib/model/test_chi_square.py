import numpy as np

from calib.model.chi_square import chi2_limit, chi2_quantile


def test_quantiles_are_scipys() -> None:
    from scipy import stats  # slow to import

    chance, freedom = np.array([1e-6, 1e-3, 0.5, 0.9]), np.array([[1], [2], [3], [6], [50]])
    assert np.array_equal(chi2_limit(chance, freedom), stats.chi2.isf(chance, freedom))
    assert np.array_equal(chi2_quantile(chance, freedom), stats.chi2.ppf(chance, freedom))
