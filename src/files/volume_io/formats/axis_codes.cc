#include <algorithm>
#include <array>

#include "palpate/volume_io/volume_io.h"

namespace palpate {

std::string axis_codes(const Eigen::Matrix3d& direction) {
  std::array<int, 3> row{0, 1, 2}, best = row;
  double best_fit = -1;
  do {
    const double fit =
        std::abs(direction(row[0], 0)) + std::abs(direction(row[1], 1)) + std::abs(direction(row[2], 2));
    if (fit <= best_fit + 1e-9) continue;
    best_fit = fit;
    best = row;
  } while (std::next_permutation(row.begin(), row.end()));
  std::string codes;
  for (int a = 0; a < 3; ++a) {
    const int r = best[static_cast<std::size_t>(a)];
    codes += direction(r, a) >= 0 ? "LPS"[r] : "RAI"[r];
  }
  return codes;
}

}  // namespace palpate
