"""The decorator of kernels: results as from Numba, two forms, and how much is compiled."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numba
import numpy as np
import pytest
from numba.core import config

from asyneio import jit

pytestmark = [
    pytest.mark.skipif(bool(config.DISABLE_JIT), reason="kernels are not compiled"),
    pytest.mark.skipif(
        numba.version_info[:2] not in jit.TESTED, reason="kernels are compiled as this version of Numba does"
    ),
]

#: Kernels with arrays, tuples, recursion, a constant argument, and an error.
SOURCE = """
import numpy as np
from asyneio.jit import njit

@njit(cache=True, literals=False)
def shifted(x, by):
    return x + by

@njit(cache=True)
def scaled(x, by):
    return x * by

@njit(cache=True)
def parts(values):
    if values.size == 0:
        raise ValueError("no values")
    return values.min(), values.sum() / 3.0

@njit(cache=True)
def factorial(n):
    if n < 2:
        return 1
    return n * factorial(n - 1)

@njit(cache=True)
def entry(values, n):
    low, mean = parts(values)
    return shifted(low, 1) + shifted(low, 2) + scaled(mean, 3) + scaled(mean, 4) + factorial(n)
"""


@pytest.fixture
def load(tmp_path: Path) -> Callable[[], ModuleType]:
    """Imports the kernels anew, with their cache on disk."""
    path = tmp_path / "some_kernels.py"
    path.write_text(SOURCE)

    def load() -> ModuleType:
        spec = importlib.util.spec_from_file_location("some_kernels", path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules["some_kernels"] = module
        spec.loader.exec_module(module)
        return module

    return load


VALUES = np.array([0.1, 0.7, 1e-9, 3.3])


def test_results_are_those_of_python_and_of_numba(load: Callable[[], ModuleType]) -> None:
    kernels = load()
    low, mean = VALUES.min(), VALUES.sum() / 3.0
    assert kernels.entry(VALUES, 5) == (low + 1) + (low + 2) + mean * 3 + mean * 4 + 120
    assert kernels.parts(VALUES) == numba.njit(kernels.parts.py_func)(VALUES)


def test_other_versions_of_numba_compile_in_their_own_way(
    load: Callable[[], ModuleType], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the same results, and without a look at what is inside them."""
    expected = load().entry(VALUES, 5)
    monkeypatch.setattr(jit, "TESTED", ())
    monkeypatch.setitem(sys.modules, "asyneio.kernel_forms", None)
    kernels = load()
    assert kernels.entry(VALUES, 5) == expected
    assert not hasattr(kernels.entry, "inner")


def test_errors_pass_through_inner_kernels(load: Callable[[], ModuleType]) -> None:
    with pytest.raises(ValueError, match="no values"):
        load().entry(np.empty(0), 3)


def test_each_form_is_compiled_only_where_it_is_needed(load: Callable[[], ModuleType]) -> None:
    kernels = load()
    kernels.entry(VALUES, 5)
    assert len(kernels.entry.signatures) == 1
    assert not kernels.entry.inner.signatures
    assert not kernels.parts.signatures
    assert len(kernels.parts.inner.signatures) == 1
    # Two constants: one general form, or one for each.
    assert len(kernels.shifted.inner.signatures) == 1
    assert len(kernels.scaled.inner.signatures) == 2


def test_a_kernel_of_kernels_can_be_called_from_python_as_well(load: Callable[[], ModuleType]) -> None:
    kernels = load()
    kernels.entry(VALUES, 5)
    assert kernels.shifted(1.5, 2) == 3.5
    assert kernels.factorial(4) == 24


def test_functions_of_numba_call_the_entry(load: Callable[[], ModuleType]) -> None:
    kernels = load()
    mean, scaled = kernels.parts, kernels.scaled

    @numba.njit
    def outside(values: np.ndarray) -> float:
        return scaled(mean(values)[1], 2)

    assert outside(VALUES) == VALUES.sum() / 3.0 * 2
    assert len(kernels.parts.signatures) == 1
    assert not kernels.parts.inner.signatures
    assert not kernels.scaled.inner.signatures


def test_both_forms_come_from_the_cache(load: Callable[[], ModuleType]) -> None:
    kernels = load()
    expected = kernels.entry(VALUES, 5), kernels.parts(VALUES)
    again = load()
    assert (again.entry(VALUES, 5), again.parts(VALUES)) == expected
    assert again.entry.stats.cache_hits
    assert again.parts.stats.cache_hits
    assert not again.parts.stats.cache_misses
    # A new entry is compiled around inner kernels from the cache.
    third = load()
    assert third.entry(VALUES.astype(np.float32), 5) == pytest.approx(expected[0], rel=1e-6)
    assert third.factorial.inner.stats.cache_hits


def test_inner_kernels_have_no_machine_code(load: Callable[[], ModuleType]) -> None:
    kernels = load()
    kernels.entry(VALUES, 5)
    kernels.parts(VALUES)
    (inner,) = kernels.parts.inner.overloads.values()
    (entry,) = kernels.parts.overloads.values()
    sizes = [len(form.library._get_compiled_object()) for form in (inner, entry)]
    assert 2 * sizes[0] < sizes[1]
    assert inner.fndesc.llvm_cpython_wrapper_name not in str(inner.library._final_module)


def test_importing_the_package_compiles_nothing() -> None:
    code = (
        "from numba.core import event\n"
        "from asyneio.kernel_forms import Kernel\n"
        "seen = []\n"
        "real = Kernel._compile_for_args\n"
        "Kernel._compile_for_args = lambda self, *a, **k: (seen.append(self), real(self, *a, **k))[1]\n"
        "import asyneio.pipeline, asyneio.live, asyneio.studies\n"
        "print(*(k.py_func.__qualname__ for k in seen))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
