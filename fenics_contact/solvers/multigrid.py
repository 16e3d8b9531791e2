"""Smoothed aggregation by PETSc, whose finest level, where the work is, smooths in blocks of three by our own sweeps."""

from typing import Any

from petsc4py import PETSc

from fenics_contact.assembly.block_operator import BlockOperator
from fenics_contact.assembly.gauss_seidel import GaussSeidel
from fenics_contact.assembly.petsc_memory import HANDLE, called
from fenics_contact.types import Mat

# Before and after the correction from below: by Gauss-Seidel, down and up, on the finest level; by Chebyshev on the others
RELAXED, SWEEPS = 2, 3
OPTIONS = {
    # parts of the largest eigenvalue between which the smoother damps: PETSc's own for smoothed aggregation
    "levels_ksp_chebyshev_esteig": "0,0.05,0,1.05",
    # the coarsest matrix is on one process, and singular where supports hold all nodes of an aggregate
    "coarse_pc_type": "bjacobi",
    "coarse_sub_pc_type": "lu",
    "coarse_sub_pc_factor_shift_type": "inblocks",
}


def hierarchy_of(scalars: Mat, prefix: str) -> Any:
    """PETSc's smoothed aggregation of a matrix by scalars with its near null space, as PC, or another one that options with
    `prefix` name. Raises PETSc.Error. Collective."""
    hierarchy = PETSc.PC().create(scalars.comm)
    hierarchy.setOptionsPrefix(prefix)
    hierarchy.setType("gamg")
    hierarchy.setOperators(scalars)
    hierarchy.setFromOptions()
    hierarchy.setUp()
    return hierarchy


def multigrid(hierarchy: Any, blocks: BlockOperator, prefix: str) -> tuple[Any, GaussSeidel | None]:
    """A V-cycle as PC of the levels of `hierarchy_of`, whose matrix by scalars is needed no more then, and what must live as
    long.

    blocks: the same matrix, which the finest level smooths with, rounded. Options with `prefix` + "cycle_" reach the cycle.
    A hierarchy without levels, or another PC, is returned as it is, and nothing else must live. Raises PETSc.Error.
    Collective.
    """
    if hierarchy.getType() != "gamg" or (levels := hierarchy.getMGLevels()) < 2:
        return hierarchy, None
    cycle = PETSc.PC().create(hierarchy.comm)
    cycle.setOptionsPrefix(prefix + "cycle_")
    cycle.setType("mg")
    cycle.setMGLevels(levels)
    cycle.setOperators(blocks.mat)
    for level in range(levels):
        smoother, above = cycle.getMGSmoother(level), hierarchy.getMGSmoother(level)
        matrix = above.getOperators()[0]
        if level:
            interpolation = hierarchy.getMGInterpolation(level)
            interpolation.setOption(PETSc.Mat.Option.USE_INODES, False)  # PETSc's products by inodes take thrice as long
            cycle.setMGInterpolation(level, interpolation)
            interpolation.destroy()
            smoother.setType("chebyshev")
            smoother.setNormType(PETSc.KSP.NormType.NONE)
            smoother.setTolerances(max_it=SWEEPS)
        if level + 1 == levels:
            smoother.setType("richardson")
            smoother.setTolerances(max_it=1)
            smoother.setOperators(blocks.rounded)
            relaxation = GaussSeidel(smoother.getPC(), blocks, RELAXED)
        else:
            matrix.setOption(PETSc.Mat.Option.USE_INODES, False)
            called("MatProductClear", HANDLE(matrix.handle))  # it keeps the finer matrix and half-way products: 1.8 kB a row
            smoother.setOperators(matrix)
            if level:
                smoother.getPC().setType("jacobi")
        for thing in (smoother, above, matrix):
            thing.destroy()
    options = PETSc.Options()
    for key, value in OPTIONS.items():
        if not options.hasName(f"{prefix}cycle_mg_{key}"):
            options[f"{prefix}cycle_mg_{key}"] = value
    cycle.setFromOptions()
    hierarchy.destroy()
    return cycle, relaxation
