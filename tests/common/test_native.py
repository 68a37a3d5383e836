"""Kernels are compiled where a compiler is, and Python code does their work where none is."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
C_CODE = """
#include "common/native.h"
static PyObject *twice(PyObject *module, PyObject *array)
{
    Py_buffer buffer;
    (void)module;
    const double *values = native_doubles(array, 3, 0, "array", &buffer);
    if (values == NULL)
        return NULL;
    PyObject *answer = PyFloat_FromDouble(2.0 * values[2]);
    PyBuffer_Release(&buffer);
    return answer;
}
static PyMethodDef methods[] = {{"twice", twice, METH_O, ""}, {NULL, NULL, 0, NULL}};
static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_twice", "", -1, methods, NULL, NULL, NULL, NULL};
PyMODINIT_FUNC PyInit__twice(void) { return native_module(&definition); }
"""
USE = """
import logging
from array import array
from common.native import kernel, kernels
module = kernel("common._twice")
print(kernels())
if module is not None:
    print(module.twice(array("d", [0.0, 1.0, 4.0])))
    for wrong in (array("d", [0.0]), array("f", [0.0, 1.0, 4.0])):
        try:
            module.twice(wrong)
        except (TypeError, ValueError) as error:
            print(error)
"""


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A source tree with one kernel."""
    (tmp_path / "common").mkdir()
    for name in ("hatch_build.py", "common/__init__.py", "common/native.py", "common/native.h"):
        shutil.copy(ROOT / name, tmp_path / name)
    (tmp_path / "common" / "_twice.c").write_text(C_CODE)
    return tmp_path


def run(tree: Path, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = {k: v for k, v in os.environ.items() if k not in ("TRILL_NATIVE", "CC")}
    environment |= {"PYTHONPATH": str(tree)} | variables
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=tree,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def test_without_a_compiler_there_is_no_kernel_and_one_line_says_so(tree: Path) -> None:
    done = run(tree, "hatch_build.py", CC="/nonexistent/cc")
    assert done.returncode == 0
    assert done.stdout == ""
    assert done.stderr.startswith("no C compiler that finds Python.h")
    assert done.stderr.count("\n") == 1
    assert run(tree, "-c", USE).stdout == "{'common._twice': False}\n"


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_a_kernel_is_used_while_it_is_of_the_present_source(tree: Path) -> None:
    assert run(tree, "hatch_build.py").stdout == "common/_twice.abi3.so\n"
    used = run(tree, "-c", USE)
    assert used.stdout.splitlines() == [
        "{'common._twice': True}",
        "8.0",
        "array: expected 3 numbers, got 1",
        "array: expected an array of float64, got format f",
    ]
    off = "{'common._twice': False}\n"
    assert run(tree, "-c", USE, TRILL_NATIVE="0").stdout == off
    (tree / "common" / "_twice.c").write_text(C_CODE + "\n")
    stale = run(tree, "-c", USE)
    assert stale.stdout == off
    assert "build it again with `python hatch_build.py`" in stale.stderr


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_a_kernel_that_does_not_compile_fails_the_build(tree: Path) -> None:
    (tree / "common" / "_twice.c").write_text(C_CODE.replace("2.0 *", "2.0 x"))
    done = run(tree, "hatch_build.py")
    assert done.returncode != 0
    assert "_twice.c:" in done.stderr
    assert not list(tree.rglob("*.so"))
