#include "loading/body.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace palpate {
namespace {

enum : std::uint8_t { kBarred = 0, kOpen = 1, kReached = 2 };

/// Flood fill by faces over runs of rows; sets kOpen to kReached.
class Flood {
 public:
  /// @param cells  kBarred, kOpen or kReached for every voxel, i fastest
  /// @param plane  axis along which the fill does not spread; -1: none
  Flood(const std::array<int, 3>& dims, std::vector<std::uint8_t>& cells, int plane = -1)
      : dims_(dims), cells_(cells), plane_(plane) {}

  void from(int i, int j, int k) {
    if (cells_[index(i, j, k)] == kOpen) stack_.push_back({i, j, k});
    while (!stack_.empty()) {
      const auto [si, sj, sk] = stack_.back();
      stack_.pop_back();
      if (cells_[index(si, sj, sk)] == kOpen) fill_run(si, sj, sk);
    }
  }

 private:
  std::size_t index(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * static_cast<std::size_t>(dims_[1]) + static_cast<std::size_t>(j)) *
               static_cast<std::size_t>(dims_[0]) +
           static_cast<std::size_t>(i);
  }
  void fill_run(int i, int j, int k) {
    int low = i, high = i;
    if (plane_ != 0) {
      while (low > 0 && cells_[index(low - 1, j, k)] == kOpen) --low;
      while (high + 1 < dims_[0] && cells_[index(high + 1, j, k)] == kOpen) ++high;
    }
    for (int n = low; n <= high; ++n) cells_[index(n, j, k)] = kReached;
    if (plane_ != 1 && j > 0) push_runs(low, high, j - 1, k);
    if (plane_ != 1 && j + 1 < dims_[1]) push_runs(low, high, j + 1, k);
    if (plane_ != 2 && k > 0) push_runs(low, high, j, k - 1);
    if (plane_ != 2 && k + 1 < dims_[2]) push_runs(low, high, j, k + 1);
  }
  void push_runs(int low, int high, int j, int k) {
    for (int n = low; n <= high; ++n)
      if (cells_[index(n, j, k)] == kOpen && (n == low || cells_[index(n - 1, j, k)] != kOpen))
        stack_.push_back({n, j, k});
  }

  std::array<int, 3> dims_;
  std::vector<std::uint8_t>& cells_;
  int plane_;
  std::vector<std::array<int, 3>> stack_;
};

/// Calls visit(i, j, k) for the voxels on the faces of the volume, except those perpendicular to axis
/// `plane`.
template <class Visit>
void for_each_border_voxel(const std::array<int, 3>& dims, int plane, const Visit& visit) {
  for (int axis = 0; axis < 3; ++axis) {
    if (axis == plane) continue;
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    std::array<int, 3> at{};
    for (const int side : {0, dims[static_cast<std::size_t>(axis)] - 1}) {
      at[static_cast<std::size_t>(axis)] = side;
      for (int a = 0; a < dims[static_cast<std::size_t>(u)]; ++a)
        for (int b = 0; b < dims[static_cast<std::size_t>(v)]; ++b) {
          at[static_cast<std::size_t>(u)] = a;
          at[static_cast<std::size_t>(v)] = b;
          visit(at[0], at[1], at[2]);
        }
    }
  }
}

/// Adds enclosed cavities to a body: in space if `plane` is -1, otherwise within each slice perpendicular to
/// that axis.
void add_enclosed(const std::array<int, 3>& dims, int plane, std::vector<std::uint8_t>& body) {
  std::vector<std::uint8_t> cells(body.size());
  std::ranges::transform(body, cells.begin(), [](std::uint8_t in) { return in ? kBarred : kOpen; });
  Flood flood(dims, cells, plane);
  for_each_border_voxel(dims, plane, [&](int i, int j, int k) { flood.from(i, j, k); });
  for (std::size_t v = 0; v < body.size(); ++v) body[v] = cells[v] != kReached;
}

int axial_axis(const GridGeometry& grid) {
  int axis = 0;
  grid.direction.row(2).cwiseAbs().maxCoeff(&axis);
  return axis;
}

}  // namespace

Result<std::vector<std::uint8_t>> body_mask(const Volume<LabelId>& labels, const Volume<float>* scan,
                                            std::optional<double> air_below, const Progress& progress) {
  const std::array<int, 3>& dims = labels.geometry().dims;
  std::vector<std::uint8_t> body(labels.voxels().size());
  std::ranges::transform(labels.voxels(), body.begin(), [](LabelId label) { return label != 0; });
  progress.report("finding the body", 0);
  if (scan && air_below) {
    std::vector<std::uint8_t> cells(body.size());
    for (std::size_t v = 0; v < cells.size(); ++v)
      cells[v] = body[v] || scan->voxels()[v] >= *air_below ? kOpen : kBarred;
    Flood flood(dims, cells);
    std::size_t v = 0;
    for (int k = 0; k < dims[2]; ++k) {
      if (progress.stopped()) return Progress::interrupted();
      for (int j = 0; j < dims[1]; ++j)
        for (int i = 0; i < dims[0]; ++i, ++v)
          if (body[v]) flood.from(i, j, k);
    }
    for (std::size_t n = 0; n < body.size(); ++n) body[n] = cells[n] == kReached;
  }
  progress.report("finding the body", 0.5);
  if (progress.stopped()) return Progress::interrupted();
  add_enclosed(dims, -1, body);
  if (progress.stopped()) return Progress::interrupted();
  add_enclosed(dims, axial_axis(labels.geometry()), body);
  return body;
}

}  // namespace palpate
