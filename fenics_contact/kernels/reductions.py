"""Questions about whole arrays in kernels.

NumPy's own ones would have Numba import SciPy's linear algebra whenever it loads the kernel, for 0.1 s of CPU time.
"""

from numba import njit

from fenics_contact.types import Bools, Ints64


@njit(cache=True)
def greatest(numbers: Ints64) -> int:
    """The greatest of numbers (n, k), -1 where there is none greater."""
    most = -1
    for i in range(numbers.shape[0]):
        for j in range(numbers.shape[1]):
            most = max(most, numbers[i, j])
    return most


@njit(cache=True)
def same(one: Ints64, other: Ints64) -> bool:
    """Whether two lists have the same numbers."""
    if len(one) != len(other):
        return False
    i = 0
    while i < len(one) and one[i] == other[i]:
        i += 1
    return i == len(one)


@njit(cache=True)
def any_true(values: Bools, start: int, end: int) -> bool:
    """Whether one of values (n,) from start to before end is true."""
    while start < end and not values[start]:
        start += 1
    return start < end
