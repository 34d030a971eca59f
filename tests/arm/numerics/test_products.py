"""Products in one order: right, the same whatever BLAS there is, and the only ones that planning uses."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from arm.numerics.products import mul, nearest_rotation, norm, solve_positive
from arm.se3 import orthonormalised, rotation

ROOT = Path(__file__).resolve().parents[3]
# What decides nothing but a threshold that the last bits do not reach.
ALLOWED = {
    ("arm/se3.py", "np.linalg.svd"),
    ("arm/se3.py", "np.linalg.det"),
    ("arm/io/rules.py", "np.linalg.det"),
    ("arm/io/rules.py", "np.linalg.eigvalsh"),
    ("arm/robot/shapes.py", "np.linalg.svd"),
    ("plan/kinematics/numeric_ik.py", "np.linalg.svd"),
}
OF_BLAS = (
    "np.linalg.",
    "np.dot",
    "np.vdot",
    "np.inner",
    "np.matmul",
    "np.tensordot",
    "scipy.linalg.",
    "np.cov",
)
# numpy's own code for these rounds otherwise on processors with AVX-512: arm.angles and math have them.
OF_NUMPY = frozenset(
    f"np.{name}"
    for name in (
        *(
            "arccos",
            "arcsin",
            "arctan",
            "arctan2",
            "tan",
            "cbrt",
            "exp",
            "expm1",
            "log",
            "log2",
            "log10",
            "log1p",
        ),
        *("power", "float_power", "sinh", "cosh", "tanh", "arcsinh", "arccosh", "arctanh"),
    )
)


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ((3,), (3,)), ((4, 4), (4, 4)), ((3, 3), (3,)), ((6,), (6, 2)), ((5, 7), (7, 2)), ((9, 3, 3), (9, 3, 3)),
        ((2, 5, 3, 3), (5, 3, 1)), ((4, 3), (8, 3, 6)), ((8, 12, 6), (8, 6, 3)), ((6, 20, 12), (12, 2)),
        ((3, 0), (0, 2)),
    ],
)  # fmt: skip
def test_products_are_those_of_numpy(left: tuple[int, ...], right: tuple[int, ...]) -> None:
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=left), rng.normal(size=right)
    found = mul(a, b)
    assert np.shape(found) == (a @ b).shape
    assert np.allclose(found, a @ b, rtol=0.0, atol=1e-14)


def test_arguments_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match=r"shape|dimension|mismatch"):
        mul(np.zeros((2, 3, 3)), np.zeros((2, 4, 3)))


def test_lengths() -> None:
    v = np.random.default_rng(2).normal(size=(4, 3))
    assert norm(v) == pytest.approx(float(np.sqrt((v * v).sum())))
    assert norm([]) == 0.0


@pytest.mark.parametrize("n", [1, 3, 6, 7])
def test_solutions_of_positive_matrices(n: int) -> None:
    rng = np.random.default_rng(n)
    J, b = rng.normal(size=(50, n + 2, n)), rng.normal(size=(50, n))
    H = np.swapaxes(J, 1, 2) @ J + 1e-6 * np.eye(n)
    x = solve_positive(H, b)
    assert np.abs(np.einsum("mij,mj->mi", H, x) - b).max() < 1e-8
    for one in range(5):
        assert np.abs(solve_positive(H[one], b[one]) - x[one]).max() < 1e-9


def test_directions_without_rank_get_nothing() -> None:
    H = np.diag([4.0, 0.0, 1.0])
    assert solve_positive(H, np.array([8.0, 3.0, 2.0])).tolist() == [2.0, 0.0, 2.0]
    assert solve_positive(np.stack([H, H]), np.ones((2, 3))).tolist() == [[0.25, 0.0, 1.0]] * 2


def test_the_nearest_rotation_is_that_of_the_singular_values() -> None:
    rng = np.random.default_rng(5)
    for size in (0.0, 1e-9, 1e-5, 1e-2, 0.2):
        M = rotation(rng.normal(size=3)) + size * rng.normal(size=(3, 3))
        U, _, Vt = np.linalg.svd(M)
        R = nearest_rotation(M)
        assert np.abs(R - U @ Vt).max() < 1e-14
        assert np.abs(R.T @ R - np.eye(3)).max() < 1e-15


@pytest.mark.parametrize("room", ["arm", "plan"])
def test_nothing_that_decides_asks_blas_or_numpys_own_inverse_functions(room: str) -> None:
    """No ``@``, no np.linalg but for lengths along an axis, which numpy sums itself, and none of `OF_NUMPY`."""
    found = []
    for file in sorted((ROOT / "src" / room).rglob("*.py")):
        name, tree = str(file.relative_to(ROOT / "src")), ast.parse(file.read_text())
        found += [
            f"{name}:{node.lineno}: @" for node in ast.walk(tree)
            if isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.MatMult)
        ]  # fmt: skip
        for node in ast.walk(tree):
            if not isinstance(node, ast.Call):
                continue
            called = ast.unparse(node.func)
            along = called == "np.linalg.norm" and any(k.arg == "axis" for k in node.keywords)
            if called in OF_NUMPY:
                found.append(f"{name}:{node.lineno}: {called}")
            if (
                "(" not in called
                and called.startswith(OF_BLAS)
                and not along
                and (name, called) not in ALLOWED
            ):
                found.append(f"{name}:{node.lineno}: {called}")
    assert found == []


PROGRAM = """
from arm.io.storage import data_file
from cell.files.task import read_task
from plan.program.tasks import plan_task
from tasks.task2 import Q_START, task2
from arm.controller.unit import load_unit
task = read_task(data_file("scenes/task2.toml"))
case = task2()
plan = plan_task(case.scene, case.transfers[:2], Q_START, load_unit("crs93"))
print(task.cell.camera.digest, task.digest, case.scene.digest, plan.sha256)
"""


def _said(**environment: str) -> str:
    path = f"{ROOT / 'tests' / 'support'}"
    ran = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env={**os.environ, "PYTHONPATH": path, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return ran.stdout


@pytest.mark.slow
def test_digests_and_plans_are_the_same_bytes_under_every_kernel_of_blas() -> None:
    """Two scenes' cubes, planned with the kernels of four kinds of processor, with one thread and two."""
    wanted = _said(OPENBLAS_CORETYPE="Haswell", OPENBLAS_NUM_THREADS="1")
    assert len(wanted.split()) == 4
    for core, threads in (("Prescott", "2"), ("Nehalem", "1"), ("Sandybridge", "1")):
        assert _said(OPENBLAS_CORETYPE=core, OPENBLAS_NUM_THREADS=threads) == wanted, core
    assert _said(NPY_DISABLE_CPU_FEATURES="AVX512_SPR AVX512_ICL X86_V4") == wanted, "numpy without AVX-512"


def test_a_typed_pose_is_made_rigid_in_one_way() -> None:
    T = np.eye(4)
    T[:3, :3] = np.round(rotation([0.3, -1.2, 0.7]), 5)
    once = orthonormalised(T)
    assert np.array_equal(orthonormalised(T), once)
    assert np.abs(once[:3, :3].T @ once[:3, :3] - np.eye(3)).max() < 1e-15
    assert np.abs(once - T).max() < 1e-5
