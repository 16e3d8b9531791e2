"""What PETSc holds of vectors and of matrices of blocks, without copies: petsc4py gives no access to it."""

import ctypes
from typing import Any

import numpy as np
from petsc4py import PETSc

from fenics_contact.types import Array, Mat

_PETSC = ctypes.CDLL(PETSc.__file__)
INT = ctypes.c_int64 if np.dtype(PETSc.IntType).itemsize == 8 else ctypes.c_int32
HANDLE = ctypes.c_void_p
_memory = ctypes.pythonapi.PyMemoryView_FromMemory
_memory.restype, _memory.argtypes = ctypes.py_object, (ctypes.c_void_p, ctypes.c_ssize_t, ctypes.c_int)
INTS, REALS = np.dtype(PETSc.IntType), np.dtype(float)
_WRITTEN = 0x200  # Python's PyBUF_WRITE
Rows = tuple[Array, Array, Array]  # offsets, columns, blocks by columns, flat


def own_part(matrix: Mat) -> Mat:
    """The block of a matrix that couples a process's own nodes with one another, counted from zero."""
    return matrix if matrix.comm.size == 1 else matrix.getDiagonalBlock()


def block_rows(matrix: ctypes.c_void_p) -> Rows:
    """The block rows of a process's own matrix, where PETSc holds them."""
    return _rows(matrix, "BAIJ", 9)


def values_of(matrix: Mat) -> list[Array]:
    """What a process's rows hold of a matrix of 3x3 blocks or of scalars, where PETSc holds it: in its own columns, and on
    several ranks in those of others."""
    kind = _kind(matrix)
    parts = row_parts(matrix)[:2] if matrix.comm.size > 1 else [HANDLE(matrix.handle)]
    return [_rows(part, kind, 9 if kind == "BAIJ" else 1)[2] for part in parts]


def _kind(matrix: Mat) -> str:
    """BAIJ or AIJ, whatever the ranks."""
    return str(matrix.getType()[3:].upper())


def _rows(matrix: ctypes.c_void_p, kind: str, size: int) -> Rows:
    """Of a process's own matrix by blocks of so many entries, or by scalars."""
    count, done = INT(), ctypes.c_int()
    offsets, columns, values = HANDLE(), HANDLE(), HANDLE()
    called("MatGetRowIJ", matrix, INT(0), 0, 1 if size > 1 else 0, *map(ctypes.byref, (count, offsets, columns, done)))
    called(f"MatSeq{kind}GetArray", matrix, ctypes.byref(values))
    starts = array_at(offsets, INTS, count.value + 1)
    return starts, array_at(columns, INTS, starts[-1]), array_at(values, REALS, size * starts[-1])


def row_parts(matrix: Mat) -> tuple[ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]:
    """Of a matrix of several ranks a process's own rows: those of its own columns, those of others', and these' numbers."""
    (own, others, numbers), kind = (HANDLE(), HANDLE(), HANDLE()), _kind(matrix)
    called(f"MatMPI{kind}GetSeq{kind}", HANDLE(matrix.handle), *map(ctypes.byref, (own, others, numbers)))
    return own, others, numbers


def other_columns(matrix: Mat) -> Array:
    """Numbers of the block columns of other processes that a process's own rows have, rising; a matrix of several ranks."""
    (_, others, numbers), rows, columns = row_parts(matrix), INT(), INT()
    called("MatGetSize", others, ctypes.byref(rows), ctypes.byref(columns))
    return array_at(numbers, INTS, columns.value // 3)


def array_at(address: ctypes.c_void_p, kind: Any, size: int) -> Array:
    """PETSc's memory as an array of numpy's type `kind`: numpy's own way leaves a cycle of objects behind each time, and
    ctypes' arrays have a type of their own for each size."""
    return np.frombuffer(_memory(address, int(size) * kind.itemsize, _WRITTEN), kind) if size else np.empty(0, kind)


def called(name: str, *arguments: object) -> None:
    """Call a function of PETSc. RuntimeError with its error code."""
    if code := getattr(_PETSC, name)(*arguments):
        raise RuntimeError(f"{name}: PETSc's error {code}")


def pattern_of(matrix: Mat) -> tuple[int, int]:
    """Two numbers that no other matrix has, nor this one once its nonzero pattern has changed."""
    number, state = ctypes.c_int64(), ctypes.c_int64()
    called("PetscObjectGetId", HANDLE(matrix.handle), ctypes.byref(number))
    called("MatGetNonzeroState", HANDLE(matrix.handle), ctypes.byref(state))
    return number.value, state.value
