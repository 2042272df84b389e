#include <algorithm>
#include <cmath>
#include <utility>

#include "palpate/cohort/thickness.h"

namespace palpate {
namespace {

constexpr float kFar = 1e30f;

/// One pass of the separable distance transform along a row: lower envelope of parabolas with their vertices
/// at the voxels.
struct Envelope {
  std::vector<int> position;
  std::vector<double> until;

  template <class Get, class Put>
  void pass(int count, double spacing_mm, const Get& get, const Put& put) {
    position.clear();
    until.clear();
    for (int n = 0; n < count; ++n) {
      const double height = get(n);
      if (height >= kFar) continue;
      const double at = n * spacing_mm;
      while (true) {
        if (position.empty()) {
          position.push_back(n);
          until.push_back(-1e300);
          break;
        }
        const double other = position.back() * spacing_mm;
        // intersection of the two parabolas
        const double meet =
            ((height + at * at) - (get(position.back()) + other * other)) / (2 * (at - other));
        if (meet > until.back()) {
          position.push_back(n);
          until.push_back(meet);
          break;
        }
        position.pop_back();
        until.pop_back();
      }
    }
    if (position.empty()) return;
    std::size_t now = 0;
    for (int n = 0; n < count; ++n) {
      const double at = n * spacing_mm;
      while (now + 1 < position.size() && until[now + 1] <= at) ++now;
      const double off = at - position[now] * spacing_mm;
      put(n, position[now], off * off);
    }
  }
};

}  // namespace

NearestOutside nearest_outside(const std::array<int, 3>& dims, const Eigen::Vector3d& spacing_mm,
                               const std::vector<std::uint8_t>& outside) {
  NearestOutside nearest;
  const std::size_t count = outside.size();
  nearest.squared_mm2.resize(count);
  nearest.index.resize(count);
  for (std::size_t n = 0; n < count; ++n) {
    nearest.squared_mm2[n] = outside[n] ? 0 : kFar;
    nearest.index[n] = outside[n] ? static_cast<std::int32_t>(n) : -1;
  }
  Envelope envelope;
  std::vector<float> squared;
  std::vector<std::int32_t> index;
  std::size_t stride = 1;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const int length = dims[axis];
    squared.resize(static_cast<std::size_t>(length));
    index.resize(static_cast<std::size_t>(length));
    const std::size_t rows = count / static_cast<std::size_t>(std::max(length, 1));
    for (std::size_t row = 0; row < rows; ++row) {
      const std::size_t first = row % stride + row / stride * stride * static_cast<std::size_t>(length);
      for (int n = 0; n < length; ++n) {
        squared[static_cast<std::size_t>(n)] =
            nearest.squared_mm2[first + static_cast<std::size_t>(n) * stride];
        index[static_cast<std::size_t>(n)] = nearest.index[first + static_cast<std::size_t>(n) * stride];
      }
      envelope.pass(
          length, spacing_mm[static_cast<Eigen::Index>(axis)],
          [&](int n) { return static_cast<double>(squared[static_cast<std::size_t>(n)]); },
          [&](int n, int from, double more) {
            const std::size_t at = first + static_cast<std::size_t>(n) * stride;
            nearest.squared_mm2[at] = static_cast<float>(squared[static_cast<std::size_t>(from)] + more);
            nearest.index[at] = index[static_cast<std::size_t>(from)];
          });
    }
    stride *= static_cast<std::size_t>(length);
  }
  for (float& value : nearest.squared_mm2)
    if (value >= kFar) value = -1;
  return nearest;
}

namespace {

/// Medial surface of a structure in its bounding box, extended by a voxel within the volume.
class MedialSurface {
 public:
  /// Point of the medial surface.
  struct Middle {
    float thickness_mm;
    std::uint32_t voxel;
  };

  /// @param labels  outlives this object
  MedialSurface(const Volume<LabelId>& labels, const SegmentStatistics& structure);

  /// Finds the points, in ascending order of thickness; none if the box is empty or too large for 32-bit
  /// indices.
  std::vector<Middle> collect();
  /// Voxel within the box.
  std::array<int, 3> position_of(std::uint32_t voxel) const;
  /// First voxel of the box.
  const std::array<int, 3>& low() const { return low_; }
  /// Whether a point is within a voxel of an inscribed ball whose radius exceeds its own by a voxel: it then
  /// is a protrusion of that thicker part. Only nearby voxels are tested.
  bool is_protrusion(double thickness_mm, const std::array<int, 3>& here) const;
  /// Whether the medial surface ends near a point of it.
  bool is_rim(const std::array<int, 3>& here) const;

 private:
  std::size_t offset(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * static_cast<std::size_t>(dims_[1]) + static_cast<std::size_t>(j)) *
               static_cast<std::size_t>(dims_[0]) +
           static_cast<std::size_t>(i);
  }
  Eigen::Vector3d at(std::size_t n) const;

  const Volume<LabelId>& labels_;
  const GridGeometry& grid_;
  const LabelId id_;
  std::array<int, 3> low_, dims_;
  std::vector<std::uint8_t> outside_, is_middle_;
  NearestOutside nearest_;
};

MedialSurface::MedialSurface(const Volume<LabelId>& labels, const SegmentStatistics& structure)
    : labels_(labels), grid_(labels.geometry()), id_(structure.id) {
  for (std::size_t a = 0; a < 3; ++a) {
    low_[a] = std::max(0, structure.box_min[a] - 1);
    dims_[a] = std::min(grid_.dims[a] - 1, structure.box_max[a] + 1) - low_[a] + 1;
  }
}

Eigen::Vector3d MedialSurface::at(std::size_t n) const {
  const auto row = static_cast<std::size_t>(dims_[0]), slice = row * static_cast<std::size_t>(dims_[1]);
  return Eigen::Vector3d(static_cast<double>(n % row),
                         static_cast<double>(n / row % static_cast<std::size_t>(dims_[1])),
                         static_cast<double>(n / slice))
      .cwiseProduct(grid_.spacing_mm);
}

std::array<int, 3> MedialSurface::position_of(std::uint32_t voxel) const {
  const std::size_t n = voxel;
  const auto row = static_cast<std::size_t>(dims_[0]), rows = static_cast<std::size_t>(dims_[1]);
  return {static_cast<int>(n % row), static_cast<int>(n / row % rows), static_cast<int>(n / (row * rows))};
}

std::vector<MedialSurface::Middle> MedialSurface::collect() {
  const std::size_t count = offset(0, 0, dims_[2]);
  // 32-bit indices suffice for any label volume that fits into memory
  if (count == 0 || count > 0x7fffffff) return {};
  outside_.resize(count);
  is_middle_.resize(count);
  for (int k = 0; k < dims_[2]; ++k)
    for (int j = 0; j < dims_[1]; ++j)
      for (int i = 0; i < dims_[0]; ++i)
        outside_[offset(i, j, k)] = labels_.at(low_[0] + i, low_[1] + j, low_[2] + k) != id_;
  nearest_ = nearest_outside(dims_, grid_.spacing_mm, outside_);

  std::vector<Middle> middle;
  const std::array<std::size_t, 3> stride{1, offset(0, 1, 0), offset(0, 0, 1)};
  constexpr double kApart = -0.6428;  // cosine of 130 degrees
  for (int k = 0; k < dims_[2]; ++k)
    for (int j = 0; j < dims_[1]; ++j)
      for (int i = 0; i < dims_[0]; ++i) {
        const std::size_t n = offset(i, j, k);
        if (outside_[n] || nearest_.index[n] < 0) continue;
        const std::array<int, 3> here{i, j, k};
        for (std::size_t a = 0; a < 3; ++a) {
          if (here[a] + 1 >= dims_[a]) continue;
          if (outside_[n + stride[a]]) {
            // thickness of one voxel
            if (here[a] == 0 || !outside_[n - stride[a]]) continue;
            middle.push_back({static_cast<float>(grid_.spacing_mm[static_cast<Eigen::Index>(a)]),
                              static_cast<std::uint32_t>(n)});
            is_middle_[n] = 1;
            continue;
          }
          const Eigen::Vector3d from = at(static_cast<std::size_t>(nearest_.index[n])),
                                to = at(static_cast<std::size_t>(nearest_.index[n + stride[a]]));
          const Eigen::Vector3d one = from - at(n), other = to - at(n + stride[a]);
          if (!(one.dot(other) <= kApart * one.norm() * other.norm())) continue;
          // distance between the two outside voxel centres, minus half a voxel on each side, along the
          // connecting line
          const Eigen::Vector3d across = to - from;
          const double length = across.norm();
          const double voxel = (across / length).cwiseAbs().dot(grid_.spacing_mm);
          middle.push_back({static_cast<float>(length - voxel), static_cast<std::uint32_t>(n)});
          is_middle_[n] = is_middle_[n + stride[a]] = 1;
        }
      }
  std::ranges::sort(middle, [](const Middle& a, const Middle& b) {
    return a.thickness_mm != b.thickness_mm ? a.thickness_mm < b.thickness_mm : a.voxel < b.voxel;
  });
  return middle;
}

bool MedialSurface::is_protrusion(double thickness_mm, const std::array<int, 3>& here) const {
  const double longest_mm = grid_.spacing_mm.maxCoeff();
  constexpr int kBelow = 4;
  // from the medial surface to the outside voxel centres, as for the balls
  const double own_mm = 0.5 * (thickness_mm + longest_mm);
  const auto from = [&](std::size_t a) { return std::max(0, here[a] - kBelow); };
  const auto to = [&](std::size_t a) { return std::min(dims_[a] - 1, here[a] + kBelow); };
  for (int k = from(2); k <= to(2); ++k)
    for (int j = from(1); j <= to(1); ++j)
      for (int i = from(0); i <= to(0); ++i) {
        const std::size_t other = offset(i, j, k);
        if (outside_[other] || nearest_.index[other] < 0) continue;
        const double radius_mm = std::sqrt(nearest_.squared_mm2[other]);
        if (radius_mm < own_mm + 0.99 * longest_mm) continue;
        const Eigen::Vector3d off =
            Eigen::Vector3d(i - here[0], j - here[1], k - here[2]).cwiseProduct(grid_.spacing_mm);
        if (off.norm() < radius_mm + longest_mm) return true;
      }
  return false;
}

bool MedialSurface::is_rim(const std::array<int, 3>& here) const {
  std::array<int, 3> reach;
  for (std::size_t a = 0; a < 3; ++a)
    reach[a] = static_cast<int>(kRim_mm / grid_.spacing_mm[static_cast<Eigen::Index>(a)]);
  // centroid of the neighbouring medial voxels: at a rim it is off to one side
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  std::size_t voxels = 0;
  for (int k = std::max(0, here[2] - reach[2]); k <= std::min(dims_[2] - 1, here[2] + reach[2]); ++k)
    for (int j = std::max(0, here[1] - reach[1]); j <= std::min(dims_[1] - 1, here[1] + reach[1]); ++j)
      for (int i = std::max(0, here[0] - reach[0]); i <= std::min(dims_[0] - 1, here[0] + reach[0]); ++i) {
        if (!is_middle_[offset(i, j, k)]) continue;
        const Eigen::Vector3d off =
            Eigen::Vector3d(i - here[0], j - here[1], k - here[2]).cwiseProduct(grid_.spacing_mm);
        if (off.squaredNorm() > kRim_mm * kRim_mm) continue;
        sum += off;
        ++voxels;
      }
  // for half a disc the centroid is at 0.42 of the radius
  constexpr double kOneSided = 0.25;
  return sum.norm() > kOneSided * kRim_mm * static_cast<double>(voxels);
}

}  // namespace

std::optional<ThinSpot> minimum_thickness(const Volume<LabelId>& labels, const SegmentStatistics& structure) {
  MedialSurface surface(labels, structure);
  for (const MedialSurface::Middle& one : surface.collect()) {
    const std::array<int, 3> here = surface.position_of(one.voxel), low = surface.low();
    if (surface.is_protrusion(one.thickness_mm, here) || surface.is_rim(here)) continue;
    const Eigen::Vector3d index(low[0] + here[0], low[1] + here[1], low[2] + here[2]);
    return ThinSpot{one.thickness_mm, labels.geometry().X_PatientVoxel() * Point<Voxel>(index)};
  }
  return std::nullopt;
}

}  // namespace palpate
