#include "surfaces/surface_net.h"

#include <algorithm>

namespace palpate::internal {

namespace {

/// Rows of a cell's corners, starting at its lowest voxel: (j, k), (j+1, k), (j, k+1), (j+1, k+1).
using CornerRows = std::array<const std::int16_t*, 4>;

std::uint8_t classes_at(const CornerRows& rows, int x) {
  unsigned bits = 0;
  for (unsigned n = 0; n < 4; ++n) {
    bits |= (rows[n][x] < 0 ? 1u : 0u) << (2 * n);
    bits |= (rows[n][x + 1] < 0 ? 1u : 0u) << (2 * n + 1);
  }
  return static_cast<std::uint8_t>(bits);
}

CellPosition mean_crossing(const CornerRows& rows, int x) {
  const auto value = [&](int corner) { return static_cast<float>(rows[corner >> 1][x + (corner & 1)]); };
  CellPosition sum = CellPosition::Zero();
  float count = 0;
  for (int from = 0; from < 8; ++from) {
    for (int a = 0; a < 3; ++a) {
      const int to = from | (1 << a);
      if (to == from || (value(from) < 0) == (value(to) < 0)) continue;
      CellPosition at(static_cast<float>(from & 1), static_cast<float>(from >> 1 & 1),
                      static_cast<float>(from >> 2), 0.0f);
      at[a] = value(from) / (value(from) - value(to));
      sum += at;
      ++count;
    }
  }
  return (sum / count).max(kCellMargin).min(1 - kCellMargin);
}

}  // namespace

std::uint32_t SurfaceNet::find(int i, int j, int k) const {
  if (j < cells.low[1] || j >= cells.high[1] || k < cells.low[2] || k >= cells.high[2]) return kNone;
  const std::size_t r = row(j, k);
  const auto begin = column.begin();
  const auto last = begin + row_begin[r + 1];
  const auto found = std::lower_bound(begin + row_begin[r], last, i);
  return found != last && *found == i ? static_cast<std::uint32_t>(found - begin) : kNone;
}

SurfaceNet make_net(const FieldRow& field, const Span3& cells, const Eigen::Vector3d& spacing_mm) {
  SurfaceNet net;
  net.cells = cells;
  net.spacing_mm = spacing_mm.cast<float>();
  net.row_begin.push_back(0);
  // number of inside voxels among the four at each column; rejects most cells
  std::vector<std::uint8_t> inside(static_cast<std::size_t>(std::max(0, cells.size(0))) + 1);
  for_each_row(cells, [&](int j, int k) {
    const CornerRows rows{field(j, k), field(j + 1, k), field(j, k + 1), field(j + 1, k + 1)};
    for (std::size_t x = 0; x < inside.size(); ++x) {
      inside[x] = static_cast<std::uint8_t>((rows[0][x] < 0 ? 1 : 0) + (rows[1][x] < 0 ? 1 : 0) +
                                            (rows[2][x] < 0 ? 1 : 0) + (rows[3][x] < 0 ? 1 : 0));
    }
    for (int x = 0; x < cells.size(0); ++x) {
      const int corners = inside[static_cast<std::size_t>(x)] + inside[static_cast<std::size_t>(x) + 1];
      if (corners == 0 || corners == 8) continue;
      const std::uint8_t bits = classes_at(rows, x);
      net.column.push_back(cells.low[0] + x);
      net.classes.push_back(bits);
      net.positions.push_back(mean_crossing(rows, x));
    }
    net.row_begin.push_back(static_cast<std::uint32_t>(net.column.size()));
  });
  return net;
}

SurfaceNet empty_net(const Span3& cells, const GridGeometry& grid) {
  SurfaceNet net;
  net.cells = cells;
  net.spacing_mm = grid.spacing_mm.cast<float>();
  net.row_begin.push_back(0);
  return net;
}

void append_net(const SurfaceNet& part, SurfaceNet& net) {
  const auto before = static_cast<std::uint32_t>(net.size());
  for (std::size_t r = 1; r < part.row_begin.size(); ++r) net.row_begin.push_back(before + part.row_begin[r]);
  net.column.insert(net.column.end(), part.column.begin(), part.column.end());
  net.classes.insert(net.classes.end(), part.classes.begin(), part.classes.end());
  net.positions.insert(net.positions.end(), part.positions.begin(), part.positions.end());
}

void for_each_difference(const SurfaceNet& a, const SurfaceNet& b, const Span3& cells,
                         const std::function<void(const Index3& cell)>& visit) {
  for_each_row(cells, [&](int j, int k) {
    std::uint32_t n = a.row_begin[a.row(j, k)], m = b.row_begin[b.row(j, k)];
    const std::uint32_t n_end = a.row_begin[a.row(j, k) + 1], m_end = b.row_begin[b.row(j, k) + 1];
    while (n < n_end || m < m_end) {
      const bool in_a = n < n_end && (m == m_end || a.column[n] <= b.column[m]);
      const bool in_b = m < m_end && (n == n_end || b.column[m] <= a.column[n]);
      const int i = in_a ? a.column[n] : b.column[m];
      const bool same =
          in_a && in_b && a.classes[n] == b.classes[m] && (a.positions[n] == b.positions[m]).all();
      if (!same && i >= cells.low[0] && i < cells.high[0]) visit({i, j, k});
      n += in_a ? 1 : 0;
      m += in_b ? 1 : 0;
    }
  });
}

}  // namespace palpate::internal
