"""Smoothed aggregation by PETSc, whose finest level, where the work is, smooths in blocks of three by our own sweeps."""

from typing import Any

from petsc4py import PETSc

from fenics_contact.assembly.block_operator import BlockJacobi, Blocks, GaussSeidel
from fenics_contact.types import Mat, Solver

# Before and after the correction from below: by Gauss-Seidel, down and up, on the finest level of one process; by Chebyshev
RELAXED, SWEEPS = 2, 3
OPTIONS = {
    # parts of the largest eigenvalue between which the smoother damps: PETSc's own for smoothed aggregation
    "levels_ksp_chebyshev_esteig": "0,0.05,0,1.05",
    # so that the one step divides by 0.9 of it, which is 1: Gauss-Seidel's sweeps nearly as they are
    "finest_ksp_chebyshev_esteig": "0,0.75,0,1.05",
    # the coarsest matrix is on one process, and singular where supports hold all nodes of an aggregate
    "coarse_pc_type": "bjacobi",
    "coarse_sub_pc_type": "lu",
    "coarse_sub_pc_factor_shift_type": "inblocks",
}


def multigrid(blocks: Blocks, scalars: Mat, prefix: str) -> tuple[Any, BlockJacobi | None]:
    """A V-cycle as PC of the hierarchy that PETSc makes of a matrix by scalars, and what must live as long.

    blocks: the matrix that the finest level smooths with, rounded; scalars: with the near null space, needed no more
    afterwards. Options with `prefix` reach PETSc's aggregation, those with `prefix` + "cycle_" the cycle; another PC that
    they name is made of `scalars` as it is, and nothing else must live. Raises PETSc.Error. Collective.
    """
    hierarchy = PETSc.PC().create(scalars.comm)
    hierarchy.setOptionsPrefix(prefix)
    hierarchy.setType("gamg")
    hierarchy.setOperators(scalars)
    hierarchy.setFromOptions()
    hierarchy.setUp()
    if hierarchy.getType() != "gamg" or (levels := hierarchy.getMGLevels()) < 2:
        return hierarchy, None
    cycle = PETSc.PC().create(scalars.comm)
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
            smoother.setOperators(blocks.rounded)
            relaxation = _relaxation(smoother, blocks, prefix)
        else:
            matrix.setOption(PETSc.Mat.Option.USE_INODES, False)
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


def _relaxation(smoother: Solver, blocks: Blocks, prefix: str) -> BlockJacobi:
    """What the finest level's Chebyshev is preconditioned with, in one step where that is by sweeps."""
    if blocks.mat.comm.size > 1:
        return BlockJacobi(smoother.getPC(), blocks)
    smoother.setOptionsPrefix(f"{prefix}cycle_mg_finest_")
    smoother.setTolerances(max_it=1)
    return GaussSeidel(smoother.getPC(), blocks, RELAXED)
