/* Several cells at once: what FFCx writes for a number is computed for `lanes`, which hold a number of each cell.
 *
 * Set by lanes.py: ROWS, COLUMNS, nodes of a cell's test and trial functions (COLUMNS 1 of a linear form), with HIGH and WIDE
 * dofs each (WIDE 1); WEIGHTS, coefficients of a cell; NODES of its geometry; HALF: 1 where the kernel leaves out the blocks
 * right of the diagonal of a symmetric matrix, 2 those below it, 0: none. */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#if defined(__AVX512F__)
#define LANES 8
#elif defined(__AVX__)
#define LANES 4
#else
#define LANES 2
#endif
typedef double lanes __attribute__((vector_size(8 * LANES)));
typedef void lanes_kernel(lanes* restrict A, const lanes* restrict w, const double* restrict c, const lanes* restrict x);
#define ALL(number) ((number) + (lanes){0.0})

/* Functions of numbers, or of lanes, are taken lane by lane. */
#define BY_LANE(f) \
  static inline lanes f##_by_lane(lanes x) { for (int l = 0; l < LANES; ++l) x[l] = f(x[l]); return x; }
BY_LANE(sqrt) BY_LANE(log) BY_LANE(exp) BY_LANE(fabs) BY_LANE(sin) BY_LANE(cos)
static inline lanes pow_by_lane(lanes x, lanes p) { for (int l = 0; l < LANES; ++l) x[l] = pow(x[l], p[l]); return x; }
#define lanes_sqrt(x) sqrt_by_lane(ALL(x))
#define lanes_log(x) log_by_lane(ALL(x))
#define lanes_exp(x) exp_by_lane(ALL(x))
#define lanes_fabs(x) fabs_by_lane(ALL(x))
#define lanes_sin(x) sin_by_lane(ALL(x))
#define lanes_cos(x) cos_by_lane(ALL(x))
#define lanes_pow(x, p) pow_by_lane(ALL(x), ALL(p))

/* Entry of a cell's matrix, where the kernel has computed it. */
static inline double lanes_entry(const lanes* A, int i, int a, int j, int b, int l)
{
  if ((HALF == 1 && j > i) || (HALF == 2 && j < i))
    return A[(j * HIGH + b) * COLUMNS * WIDE + i * WIDE + a][l];
  return A[(i * HIGH + a) * COLUMNS * WIDE + j * WIDE + b][l];
}

/* Add the matrices (or vectors) of n cells to blocks: that of the nodes i, j of cell k, by columns, to block number
 * places[k, i, j] of `out`. w (n, WEIGHTS), c constants, x (points, 3), geometry (all cells, NODES). */
static void lanes_add(lanes_kernel* kernel, int64_t n, const int32_t* cells, const double* w, const double* c,
                      const double* x, const int32_t* geometry, const int32_t* places, double* out)
{
  lanes A[ROWS * HIGH * COLUMNS * WIDE], W[WEIGHTS + 1] = {0}, X[3 * NODES] = {0};
  for (int64_t first = 0; first < n; first += LANES)
  {
    const int count = n - first < LANES ? n - first : LANES;
    for (int l = 0; l < LANES; ++l)
    {
      const int64_t k = first + (l < count ? l : 0); /* lanes without a cell repeat one */
      for (int i = 0; i < WEIGHTS; ++i)
        W[i][l] = w[k * WEIGHTS + i];
      for (int i = 0; i < NODES; ++i)
        for (int d = 0; d < 3; ++d)
          X[3 * i + d][l] = x[3 * (int64_t)geometry[(int64_t)cells[k] * NODES + i] + d];
    }
    memset(A, 0, sizeof(A));
    kernel(A, W, c, X);
    for (int i = 0; i < ROWS; ++i)
      for (int j = 0; j < COLUMNS; ++j)
        for (int l = 0; l < count; ++l)
        {
          double* block = out + (int64_t)places[((first + l) * ROWS + i) * COLUMNS + j] * HIGH * WIDE;
          for (int b = 0; b < WIDE; ++b)
            for (int a = 0; a < HIGH; ++a)
              block[b * HIGH + a] += lanes_entry(A, i, a, j, b, l);
        }
  }
}

/* What dolfinx calls with the numbers of one cell. */
static void lanes_of_one(lanes_kernel* kernel, double* A, const double* w, const double* c, const double* x)
{
  lanes all[ROWS * HIGH * COLUMNS * WIDE] = {0}, W[WEIGHTS + 1] = {0}, X[3 * NODES];
  for (int i = 0; i < WEIGHTS; ++i)
    W[i] = ALL(w[i]);
  for (int i = 0; i < 3 * NODES; ++i)
    X[i] = ALL(x[i]);
  kernel(all, W, c, X);
  for (int i = 0; i < ROWS; ++i)
    for (int a = 0; a < HIGH; ++a)
      for (int j = 0; j < COLUMNS; ++j)
        for (int b = 0; b < WIDE; ++b)
          A[(i * HIGH + a) * COLUMNS * WIDE + j * WIDE + b] += lanes_entry(all, i, a, j, b, 0);
}
