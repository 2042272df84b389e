#include "contact/half_spaces.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// mm; rounding error of a point on a plane
constexpr double kOnPlane_mm = 1e-9;
// determinant of unit normals below which two are parallel or three are coplanar
constexpr double kMinDeterminant = 1e-12;

// tries sets of half-spaces as active ones, in coordinates relative to x
class ActiveSet {
 public:
  ActiveSet(const Point<Patient>& x, std::span<const HalfSpace> half_spaces)
      : x_(x), count_(half_spaces.size()) {
    for (std::size_t i = 0; i < count_; ++i) {
      normal_[i] = half_spaces[i].normal.eigen();
      needed_mm_[i] = -half_spaces[i].clearance(x);
      scale_mm_ = std::max(scale_mm_, std::abs(needed_mm_[i]));
    }
  }

  std::optional<ClosestPoint> solve() const {
    if (auto found = accept({}, {}, 0)) return found;
    const int n = static_cast<int>(count_);
    for (int i = 0; i < n; ++i)
      if (auto found = accept({i}, {needed_mm_[i]}, 1)) return found;
    for (int i = 0; i < n; ++i)
      for (int j = i + 1; j < n; ++j)
        if (auto found = at_edge(i, j)) return found;
    for (int i = 0; i < n; ++i)
      for (int j = i + 1; j < n; ++j)
        for (int k = j + 1; k < n; ++k)
          if (auto found = at_corner(i, j, k)) return found;
    return std::nullopt;
  }

 private:
  std::optional<ClosestPoint> at_edge(int i, int j) const {
    const double c = normal_[i].dot(normal_[j]);
    const double determinant = 1 - c * c;
    if (determinant < kMinDeterminant) return std::nullopt;
    return accept({i, j},
                  {(needed_mm_[i] - c * needed_mm_[j]) / determinant,
                   (needed_mm_[j] - c * needed_mm_[i]) / determinant},
                  2);
  }

  std::optional<ClosestPoint> at_corner(int i, int j, int k) const {
    Eigen::Matrix3d normals;
    normals << normal_[i], normal_[j], normal_[k];
    const double volume = normals.determinant();
    if (volume * volume < kMinDeterminant) return std::nullopt;
    // KKT system: normals^T d = needed, d = normals * pull
    const Eigen::Vector3d needed(needed_mm_[i], needed_mm_[j], needed_mm_[k]);
    const Eigen::Matrix3d inverse = normals.inverse();
    const Eigen::Vector3d pull = inverse * (inverse.transpose() * needed);
    return accept({i, j, k}, {pull[0], pull[1], pull[2]}, 3);
  }

  std::optional<ClosestPoint> accept(const std::array<int, 3>& active,
                                     const std::array<double, 3>& multiplier_mm, int count) const {
    Eigen::Vector3d displacement = Eigen::Vector3d::Zero();
    for (int n = 0; n < count; ++n) {
      if (!(multiplier_mm[n] > 0)) return std::nullopt;
      displacement += normal_[active[n]] * multiplier_mm[n];
    }
    const double slack_mm = kOnPlane_mm + 1e-9 * (scale_mm_ + displacement.norm());
    for (std::size_t i = 0; i < count_; ++i)
      if (!(normal_[i].dot(displacement) >= needed_mm_[i] - slack_mm)) return std::nullopt;
    return ClosestPoint{x_ + Vector<Patient>(displacement), active, multiplier_mm, count};
  }

  Point<Patient> x_;
  std::size_t count_;
  std::array<Eigen::Vector3d, kMaxHalfSpaces> normal_;
  std::array<double, kMaxHalfSpaces> needed_mm_;
  double scale_mm_ = 0;
};

// shortcut for a single half-space, the common case; same result as the enumeration
std::optional<ClosestPoint> closest_to_one(const Point<Patient>& x, const HalfSpace& half_space) {
  const double needed_mm = -half_space.clearance(x);
  if (needed_mm <= kOnPlane_mm + 1e-9 * std::abs(needed_mm)) return ClosestPoint{x, {}, {}, 0};
  if (!(needed_mm > 0)) return std::nullopt;
  return ClosestPoint{x + half_space.normal * needed_mm, {0}, {needed_mm}, 1};
}

}  // namespace

std::optional<ClosestPoint> closest_point(const Point<Patient>& x, std::span<const HalfSpace> half_spaces) {
  PALPATE_CHECK(half_spaces.size() <= kMaxHalfSpaces);
  if (half_spaces.size() == 1) return closest_to_one(x, half_spaces[0]);
  return ActiveSet(x, half_spaces).solve();
}

}  // namespace palpate
