#include "sampling/spline_prefilter.h"

#include <algorithm>
#include <type_traits>
#include <vector>

#include "palpate/base/for_each_index.h"

// Along one line, with c[-1] = c[n] = 0, the equations
//
//     c[k-1] + 4 c[k] + c[k+1] = 6 f[k],   k = 0 ... n-1
//
// are solved by a recursion forward and one back:
//
//     d[k] = m[k] (6 f[k] - d[k-1]),   m[k] = 1 / (4 - m[k-1]),   d[-1] = m[-1] = 0
//     c[k] = d[k] - m[k] c[k+1]
//
// These follow from Gaussian elimination of the tridiagonal system. They are also Unser's two recursive
// filters with the pole z = sqrt(3) - 2, since m[k] converges to -z within about ten voxels, and the first
// m[k] are his initial values for this boundary. Along j and k a whole row of lines is processed side by
// side, which the compiler vectorises; along i four rows are, to hide the latency of the recursion.
namespace palpate::internal {

namespace {

constexpr std::integral_constant<std::size_t, 1> kNeighbours;

std::vector<float> pivots(int n) {
  std::vector<float> m(static_cast<std::size_t>(n));
  double previous = 0;
  for (float& pivot : m) {
    previous = 1 / (4 - previous);
    pivot = static_cast<float>(previous);
  }
  return m;
}

/// Filters `lines` lines of m.size() values each, with `step` between the values of a line and `apart`
/// between lines. `apart` is a compile-time constant for adjacent lines.
template <class Distance>
void filter_lines(float* first, std::size_t step, const std::vector<float>& m, std::size_t lines,
                  Distance apart) {
  const std::size_t n = m.size();
  for (std::size_t line = 0; line < lines; ++line) first[line * apart] *= 6 * m[0];
  for (std::size_t k = 1; k < n; ++k) {
    float* now = first + k * step;
    const float* before = now - step;
    for (std::size_t line = 0; line < lines; ++line) {
      now[line * apart] = m[k] * (6 * now[line * apart] - before[line * apart]);
    }
  }
  for (std::size_t k = n - 1; k-- > 0;) {
    float* now = first + k * step;
    const float* after = now + step;
    for (std::size_t line = 0; line < lines; ++line) now[line * apart] -= m[k] * after[line * apart];
  }
}

}  // namespace

void spline_prefilter(Volume<float>& values, int threads) {
  if (values.empty()) return;
  const auto& dims = values.geometry().dims;
  const auto nx = static_cast<std::size_t>(dims[0]), ny = static_cast<std::size_t>(dims[1]);
  const std::size_t slice = nx * ny;
  const auto mi = pivots(dims[0]), mj = pivots(dims[1]), mk = pivots(dims[2]);
  float* const voxels = values.voxels().data();

  constexpr std::size_t kRows = 4;
  for_each_index(dims[2], worker_count(threads, dims[2]), [&](int, int k) {
    float* const plane = voxels + static_cast<std::size_t>(k) * slice;
    for (std::size_t j = 0; j < ny; j += kRows) {
      filter_lines(plane + j * nx, 1, mi, std::min(kRows, ny - j), nx);
    }
    filter_lines(plane, nx, mj, nx, kNeighbours);
    return true;
  });
  for_each_index(dims[1], worker_count(threads, dims[1]), [&](int, int j) {
    filter_lines(voxels + static_cast<std::size_t>(j) * nx, slice, mk, nx, kNeighbours);
    return true;
  });
}

}  // namespace palpate::internal
