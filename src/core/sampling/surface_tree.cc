#include "palpate/sampling/surface_tree.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <span>
#include <utility>

#include "palpate/base/check.h"

namespace palpate {
namespace {

using internal::BoundingCylinder;
using internal::BrickTree;
using internal::TreeNode;
using TreeLayout = BrickLayout;

/// Trilinear interpolant of one cell, in cell coordinates 0 ... 1.
class TrilinearCell {
 public:
  /// @param corner_mm  corner values; bit 0 of the index along i, bit 1 along j, bit 2 along k
  explicit TrilinearCell(const std::array<double, 8>& corner_mm) : corner_mm_(corner_mm) {}

  /// Value in mm and its gradient in cell coordinates.
  double at(const Eigen::Vector3d& p, Eigen::Vector3d& slope) const {
    double rows[4], row_slopes[4];
    for (int n = 0; n < 4; ++n) {
      const double from = corner_mm_[static_cast<std::size_t>(2 * n)];
      row_slopes[n] = corner_mm_[static_cast<std::size_t>(2 * n + 1)] - from;
      rows[n] = from + p[0] * row_slopes[n];
    }
    const auto lerp = [](double from, double to, double fraction) { return from + fraction * (to - from); };
    const double low = lerp(rows[0], rows[1], p[1]), high = lerp(rows[2], rows[3], p[1]);
    slope[0] = lerp(lerp(row_slopes[0], row_slopes[1], p[1]), lerp(row_slopes[2], row_slopes[3], p[1]), p[2]);
    slope[1] = lerp(rows[1] - rows[0], rows[3] - rows[2], p[2]);
    slope[2] = high - low;
    return lerp(low, high, p[2]);
  }

 private:
  std::array<double, 8> corner_mm_;
};

// whether the corner values have both signs
bool is_crossed(const std::array<double, 8>& corner_mm) {
  int inside = 0;
  for (const double mm : corner_mm) inside += mm < 0 ? 1 : 0;
  return inside != 0 && inside != 8;
}

/// Value and gradient of the distance field's interpolant at a point.
struct FieldValue {
  double value_mm;
  Vector<Patient> slope;
};

/// Evaluates the distance field's interpolant with its exact gradient.
class PositionReader {
 public:
  explicit PositionReader(const SignedField& field)
      : field_(field),
        view_(field.bricks().view()),
        slope_map_(field.X_VoxelPatient().linear().transpose()) {}

  FieldValue at(const Point<Patient>& x) const {
    const Point<Voxel> p = field_.X_VoxelPatient() * x;
    const auto& dims = field_.geometry().dims;
    std::array<std::ptrdiff_t, 3> cell;
    Eigen::Vector3d fraction;
    for (int axis = 0; axis < 3; ++axis) {
      const auto a = static_cast<std::size_t>(axis);
      if (!(p[axis] >= -1 && p[axis] < dims[a])) return {field_.outside(), {}};
      const double floor = std::floor(p[axis]);
      cell[a] = static_cast<std::ptrdiff_t>(floor);
      fraction[axis] = p[axis] - floor;
    }
    const std::int16_t* const voxel = view_.cell(cell[0], cell[1], cell[2]);
    std::array<double, 8> corner_mm;
    for (std::size_t n = 0; n < 8; ++n)
      corner_mm[n] = field_.steps().offset +
                     field_.steps().scale *
                         voxel[(n & 1) + (n >> 1 & 1) * TreeLayout::kRow + (n >> 2) * TreeLayout::kSlice];
    Eigen::Vector3d slope;
    const double value_mm = TrilinearCell(corner_mm).at(fraction, slope);
    return {value_mm, Vector<Patient>(slope_map_ * slope)};
  }

 private:
  const SignedField& field_;
  BrickView<std::int16_t> view_;
  Eigen::Matrix3d slope_map_;
};

// ---- pieces of a brick

/// Cuts cells into pieces and computes the bounding cylinder of each.
class PieceMaker {
 public:
  explicit PieceMaker(const SignedField& field)
      : steps_(field.steps()),
        X_PatientVoxel_(field.geometry().X_PatientVoxel()),
        slope_map_(field.X_VoxelPatient().linear().transpose()) {
    for (int axis = 0; axis < 3; ++axis)
      parts_[axis] = std::max(
          1, static_cast<int>(std::ceil(field.geometry().spacing_mm[axis] / SurfaceTree::kPiece_mm - 1e-9)));
  }

  /// @param voxel  first voxel of the cell in its brick
  /// @param first  voxel coordinates of that voxel
  /// @param piece_bounds  the bounds of the pieces are appended
  void add(const std::int16_t* voxel, const Eigen::Vector3d& first,
           std::vector<BoundingCylinder>& piece_bounds) const {
    std::array<double, 8> corner_mm;
    for (std::size_t n = 0; n < 8; ++n)
      corner_mm[n] =
          steps_.offset +
          steps_.scale * voxel[(n & 1) + (n >> 1 & 1) * TreeLayout::kRow + (n >> 2) * TreeLayout::kSlice];
    if (!is_crossed(corner_mm)) return;
    const TrilinearCell cell(corner_mm);
    const Eigen::Array3d size = parts_.cast<double>().inverse();
    for (int k = 0; k < parts_[2]; ++k)
      for (int j = 0; j < parts_[1]; ++j)
        for (int i = 0; i < parts_[0]; ++i)
          add_piece(cell, Eigen::Array3d(i, j, k) * size, size, first, piece_bounds);
  }

 private:
  void add_piece(const TrilinearCell& cell, const Eigen::Array3d& low, const Eigen::Array3d& size,
                 const Eigen::Vector3d& first, std::vector<BoundingCylinder>& piece_bounds) const {
    std::array<double, 8> corner_mm;
    Eigen::Vector3d slope;
    const auto corner = [&](std::size_t n) -> Eigen::Vector3d {
      const auto bits = static_cast<int>(n);
      return low + Eigen::Array3i(bits & 1, bits >> 1 & 1, bits >> 2).cast<double>() * size;
    };
    for (std::size_t n = 0; n < 8; ++n) corner_mm[n] = cell.at(corner(n), slope);
    if (!is_crossed(corner_mm)) return;

    // along an edge the interpolant is linear, and every part of the surface in a piece intersects one of its
    // edges
    std::array<Eigen::Vector3d, 12> crossing;
    std::size_t count = 0;
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (std::size_t n = 0; n < 8; ++n)
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const std::size_t other = n | std::size_t{1} << axis;
        if (other == n || (corner_mm[n] < 0) == (corner_mm[other] < 0)) continue;
        const double fraction = corner_mm[n] / (corner_mm[n] - corner_mm[other]);
        crossing[count] = corner(n) + fraction * (corner(other) - corner(n));
        mean += crossing[count++];
      }
    mean /= static_cast<double>(count);

    const Eigen::Vector3d centre = on_surface(cell, mean, low, size, std::span(crossing).first(count));
    cell.at(centre, slope);
    Eigen::Vector3d normal = (slope_map_ * slope).normalized();
    if (!(normal.norm() > 0.5)) normal = Eigen::Vector3d::UnitX();
    const auto& X = X_PatientVoxel_.linear();
    const Eigen::Vector3d at_mm = X * (first + centre) + X_PatientVoxel_.translation();
    const auto [half_mm, radius_mm] = extent_of_piece(cell, centre, slope, normal, corner, corner_mm);
    constexpr double kRounding_mm = 2e-4;
    BoundingCylinder bounds;
    for (int axis = 0; axis < 3; ++axis) {
      bounds.middle[static_cast<std::size_t>(axis)] = static_cast<float>(at_mm[axis]);
      bounds.normal[static_cast<std::size_t>(axis)] = static_cast<float>(normal[axis]);
    }
    bounds.half_mm = static_cast<float>(half_mm + kRounding_mm);
    bounds.radius_mm = static_cast<float>(radius_mm + kRounding_mm);
    piece_bounds.push_back(bounds);
  }

  // Half height of a piece's surface along the normal at a point of it, and its radius across. The deviation
  // from the tangent plane is trilinear and largest at a corner, so the surface lies between two parallel
  // planes; the point of that slab farthest from the axis is on an edge of the piece.
  template <class Corner>
  std::pair<double, double> extent_of_piece(const TrilinearCell& cell, const Eigen::Vector3d& centre,
                                            const Eigen::Vector3d& slope, const Eigen::Vector3d& normal,
                                            const Corner& corner,
                                            const std::array<double, 8>& corner_mm) const {
    Eigen::Vector3d unused;
    const double here_mm = cell.at(centre, unused);
    double off_mm = 0, max_mm = 0;
    std::array<Eigen::Vector3d, 8> path;
    std::array<double, 8> along;
    for (std::size_t n = 0; n < 8; ++n) {
      off_mm = std::max(off_mm, std::abs(corner_mm[n] - here_mm - slope.dot(corner(n) - centre)));
      path[n] = X_PatientVoxel_.linear() * (corner(n) - centre);
      along[n] = normal.dot(path[n]);
      max_mm = std::max(max_mm, std::abs(along[n]));
    }
    const double steep = (slope_map_ * slope).norm();
    const double half_mm = std::min(max_mm, steep > 0 ? (off_mm + std::abs(here_mm)) / steep : max_mm);
    double radius_mm = 0;
    for (std::size_t n = 0; n < 8; ++n)
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const std::size_t other = n | std::size_t{1} << axis;
        if (other == n) continue;
        // the part of the edge between the planes
        const double rise = along[other] - along[n];
        double from = 0, to = 1;
        if (rise != 0) {
          const double a = (-half_mm - along[n]) / rise, b = (half_mm - along[n]) / rise;
          from = std::clamp(std::min(a, b), 0.0, 1.0);
          to = std::clamp(std::max(a, b), 0.0, 1.0);
        }
        for (const double fraction : {from, to}) {
          const Eigen::Vector3d at = path[n] + fraction * (path[other] - path[n]);
          const double above_mm = normal.dot(at);
          if (std::abs(above_mm) <= half_mm + 1e-9)
            radius_mm = std::max(radius_mm, (at - normal * above_mm).norm());
        }
      }
    return {half_mm, radius_mm};
  }

  // Newton's method from the mean of the edge crossings; the crossing nearest to it if that leaves the piece
  static Eigen::Vector3d on_surface(const TrilinearCell& cell, const Eigen::Vector3d& from,
                                    const Eigen::Array3d& low, const Eigen::Array3d& size,
                                    std::span<const Eigen::Vector3d> crossings) {
    constexpr double kNear_mm = 1e-6;
    constexpr int kMaxSteps = 6;
    Eigen::Vector3d p = from, slope;
    for (int step = 0; step < kMaxSteps; ++step) {
      const double value_mm = cell.at(p, slope);
      if (std::abs(value_mm) <= kNear_mm) return p;
      p -= slope * (value_mm / slope.squaredNorm());
      const Eigen::Array3d inside = (p.array() - low) / size;
      if (!((inside >= 0).all() && (inside <= 1).all())) break;
    }
    return *std::min_element(crossings.begin(), crossings.end(), [&](const auto& a, const auto& b) {
      return (a - from).squaredNorm() < (b - from).squaredNorm();
    });
  }

  SignedSteps steps_;
  Transform<Patient, Voxel> X_PatientVoxel_;
  Eigen::Matrix3d slope_map_;
  Eigen::Array3i parts_;
};

// ---- the tree

/// Extent of a bounding cylinder along a direction, and perpendicular to it.
struct Extent {
  double low, high, lateral;
};
Extent extent_of(const BoundingCylinder& bounds, const Eigen::Vector3d& from, const Eigen::Vector3d& along) {
  const Eigen::Vector3d displacement =
      Eigen::Vector3d(bounds.middle[0], bounds.middle[1], bounds.middle[2]) - from;
  const double mm = displacement.dot(along);
  const double cosine = std::min(
      1.0, std::abs(along.dot(Eigen::Vector3d(bounds.normal[0], bounds.normal[1], bounds.normal[2]))));
  const double sine = std::sqrt(1 - cosine * cosine);
  const double reach = bounds.half_mm * cosine + bounds.radius_mm * sine;
  return {mm - reach, mm + reach,
          (displacement - along * mm).norm() + bounds.half_mm * sine + bounds.radius_mm};
}

// bounding cylinder of leaves, with the mean of their normals as axis
BoundingCylinder around(std::span<const TreeNode> leaves) {
  Eigen::Array3f low = Eigen::Array3f::Constant(std::numeric_limits<float>::infinity()), high = -low;
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  for (const TreeNode& leaf : leaves) {
    const Eigen::Array3f at(leaf.bounds.middle[0], leaf.bounds.middle[1], leaf.bounds.middle[2]);
    low = low.min(at);
    high = high.max(at);
    normal += Eigen::Vector3d(leaf.bounds.normal[0], leaf.bounds.normal[1], leaf.bounds.normal[2]);
  }
  normal.normalize();
  if (!(normal.norm() > 0.5)) normal = Eigen::Vector3d::UnitX();
  Eigen::Vector3d centre = (0.5f * (low + high)).matrix().cast<double>();
  double smallest = std::numeric_limits<double>::infinity(), most = -smallest, lateral = 0;
  for (const TreeNode& leaf : leaves) {
    const Extent extent = extent_of(leaf.bounds, centre, normal);
    smallest = std::min(smallest, extent.low);
    most = std::max(most, extent.high);
    lateral = std::max(lateral, extent.lateral);
  }
  centre += normal * (0.5 * (smallest + most));
  constexpr double kRounding_mm = 2e-4;
  BoundingCylinder bounds;
  for (int axis = 0; axis < 3; ++axis) {
    bounds.middle[static_cast<std::size_t>(axis)] = static_cast<float>(centre[axis]);
    bounds.normal[static_cast<std::size_t>(axis)] = static_cast<float>(normal[axis]);
  }
  bounds.half_mm = static_cast<float>(0.5 * (most - smallest) + kRounding_mm);
  bounds.radius_mm = static_cast<float>(lateral + kRounding_mm);
  return bounds;
}

// builds a subtree at `at` by median splits along the axis of largest spread
void grow(std::span<TreeNode> leaves, std::size_t at, std::vector<TreeNode>& nodes) {
  if (leaves.size() == 1) {
    nodes[at] = leaves.front();
    return;
  }
  Eigen::Array3f low = Eigen::Array3f::Constant(std::numeric_limits<float>::infinity()), high = -low;
  for (const TreeNode& leaf : leaves) {
    const Eigen::Array3f middle(leaf.bounds.middle[0], leaf.bounds.middle[1], leaf.bounds.middle[2]);
    low = low.min(middle);
    high = high.max(middle);
  }
  Eigen::Index widest;
  (high - low).maxCoeff(&widest);
  const auto axis = static_cast<std::size_t>(widest);
  std::stable_sort(leaves.begin(), leaves.end(), [&](const TreeNode& a, const TreeNode& b) {
    return a.bounds.middle[axis] < b.bounds.middle[axis];
  });
  const std::size_t children = nodes.size(), half = leaves.size() / 2;
  nodes[at] = {around(leaves), static_cast<std::int32_t>(children)};
  nodes.resize(children + 2);
  grow(leaves.first(half), children, nodes);
  grow(leaves.subspan(half), children + 1, nodes);
}

// binary tree over leaves, root first
std::vector<TreeNode> tree_of(std::vector<TreeNode> leaves) {
  std::vector<TreeNode> nodes;
  if (leaves.empty()) return nodes;
  nodes.reserve(2 * leaves.size() - 1);
  nodes.resize(1);
  grow(leaves, 0, nodes);
  return nodes;
}

// tree of a brick's pieces; null if the surface does not cross it
std::shared_ptr<const BrickTree> brick_tree_of(const SignedField& field, const PieceMaker& pieces,
                                               std::size_t number, const std::array<int, 3>& brick) {
  const Bricks<std::int16_t>& bricks = field.bricks();
  if (bricks.is_uniform(number)) return nullptr;
  const std::int16_t* const voxels = bricks.brick(number);
  std::array<int, 3> low, begin, end;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    low[axis] = brick[axis] * TreeLayout::kCells - TreeLayout::kBorder;
    // cells from the one before the grid's first voxel to the one behind its last
    begin[axis] = std::max(0, -1 - low[axis]);
    end[axis] = std::min(TreeLayout::kCells, bricks.geometry().dims[axis] - low[axis]);
  }
  std::vector<BoundingCylinder> piece_bounds;
  for (int k = begin[2]; k < end[2]; ++k)
    for (int j = begin[1]; j < end[1]; ++j)
      for (int i = begin[0]; i < end[0]; ++i)
        pieces.add(voxels + (TreeLayout::kBefore + i) + (TreeLayout::kBefore + j) * TreeLayout::kRow +
                       (TreeLayout::kBefore + k) * TreeLayout::kSlice,
                   Eigen::Vector3d(low[0] + i, low[1] + j, low[2] + k), piece_bounds);
  if (piece_bounds.empty()) return nullptr;
  std::vector<TreeNode> leaves;
  leaves.reserve(piece_bounds.size());
  for (const BoundingCylinder& bounds : piece_bounds) leaves.push_back({bounds, -1});
  return std::make_shared<const BrickTree>(BrickTree{tree_of(std::move(leaves))});
}

// ---- queries

// lower bound of the distance to any point of a bounding cylinder
double min_mm(const BoundingCylinder& bounds, const Eigen::Vector3d& x) {
  const double e[3] = {x[0] - bounds.middle[0], x[1] - bounds.middle[1], x[2] - bounds.middle[2]};
  const double along = e[0] * bounds.normal[0] + e[1] * bounds.normal[1] + e[2] * bounds.normal[2];
  const double lateral2 = e[0] * e[0] + e[1] * e[1] + e[2] * e[2] - along * along;
  const double above = std::max(0.0, std::abs(along) - bounds.half_mm);
  const double beside = std::sqrt(std::max(0.0, lateral2)) - bounds.radius_mm;
  return beside > 0 ? std::sqrt(above * above + beside * beside) : above;
}

Eigen::Vector3d middle_of(const BoundingCylinder& bounds) {
  return {bounds.middle[0], bounds.middle[1], bounds.middle[2]};
}

// projects a point onto the surface by Newton's method; false if that fails
bool project_onto_surface(const PositionReader& position, Point<Patient>& p, Vector<Patient>& slope) {
  constexpr double kNear_mm = 2e-4, kLongest_mm = 1;
  constexpr int kMaxSteps = 5;
  for (int step = 0; step <= kMaxSteps; ++step) {
    const FieldValue here = position.at(p);
    slope = here.slope;
    const double steep2 = slope.squared_norm();
    if (!(steep2 > 0)) return false;
    const double off_mm = here.value_mm / std::sqrt(steep2);
    if (std::abs(off_mm) <= kNear_mm) return true;
    if (std::abs(off_mm) > kLongest_mm) return false;
    p = p - slope * (here.value_mm / steep2);
  }
  return false;
}

// Moves a surface point along the surface to the local minimum of its distance to x, to a few micrometres;
// returns the distance. The step is the tangential offset of x, scaled by a secant estimate of the
// curvature's effect from the previous step.
double refine_nearest(const PositionReader& position, const Point<Patient>& x, Point<Patient>& p) {
  constexpr double kEnough_mm = 5e-4, kLongest_mm = 0.5;
  constexpr int kMaxTries = 8;
  double best_mm = (x - p).norm();
  Point<Patient> at = p;
  Vector<Patient> slope;
  if (!project_onto_surface(position, at, slope)) return best_mm;
  const auto lateral_of = [&](const Point<Patient>& best_position, const Vector<Patient>& at_slope) {
    const Vector<Patient> displacement = x - best_position;
    return displacement - at_slope * (displacement.dot(at_slope) / at_slope.squared_norm());
  };
  double step_fraction = 1;
  for (int tries = 0; tries < kMaxTries; ++tries) {
    const Vector<Patient> lateral = lateral_of(at, slope);
    const double lateral_mm = lateral.norm(), step_mm = std::min(step_fraction * lateral_mm, kLongest_mm);
    if (!(lateral_mm * step_mm > 2 * kEnough_mm * std::max(best_mm, kEnough_mm))) break;
    const Vector<Patient> along = lateral * (1 / lateral_mm);
    Point<Patient> next = at + along * step_mm;
    Vector<Patient> next_slope;
    if (!project_onto_surface(position, next, next_slope)) {
      step_fraction *= 0.3;
      continue;
    }
    const double advanced_mm = lateral_mm - lateral_of(next, next_slope).dot(along);
    const double relaxation =
        advanced_mm > 0 ? std::clamp(step_mm / advanced_mm, 0.05 * step_fraction, 1.0) : 1.0;
    const double next_mm = (x - next).norm();
    if (next_mm < best_mm) {
      const bool enough = best_mm - next_mm < kEnough_mm;
      best_mm = next_mm;
      p = at = next;
      slope = next_slope;
      step_fraction = relaxation;
      if (enough) break;
    } else {
      step_fraction = std::min(relaxation, 0.5 * step_fraction);
    }
  }
  return best_mm;
}

}  // namespace

SurfaceTree::SurfaceTree(std::shared_ptr<const Surface> surface) : surface_(std::move(surface)) {
  PALPATE_CHECK(surface_ != nullptr);
  update_bricks(nullptr);
}

SurfaceTree SurfaceTree::with(std::shared_ptr<const Surface> surface) const {
  PALPATE_CHECK(surface != nullptr &&
                surface->distance_field().bricks().counts() == surface_->distance_field().bricks().counts());
  SurfaceTree now = *this;
  now.surface_ = std::move(surface);
  now.update_bricks(this);
  return now;
}

void SurfaceTree::update_bricks(const SurfaceTree* before) {
  const SignedField& position = surface_->distance_field();
  const Bricks<std::int16_t>& bricks = position.bricks();
  const PieceMaker pieces(position);
  const std::array<int, 3>& counts = bricks.counts();
  bricks_.resize(static_cast<std::size_t>(counts[0]) * static_cast<std::size_t>(counts[1]) *
                 static_cast<std::size_t>(counts[2]));
  low_.setConstant(std::numeric_limits<double>::infinity());
  high_ = -low_;
  pieces_ = 0;
  top_leaves_.clear();
  std::vector<TreeNode> leaves;
  std::size_t number = 0;
  for (int c = 0; c < counts[2]; ++c)
    for (int b = 0; b < counts[1]; ++b)
      for (int a = 0; a < counts[0]; ++a, ++number) {
        const bool known = before != nullptr &&
                           before->surface_->distance_field().bricks().brick(number) == bricks.brick(number);
        if (!known) bricks_[number] = brick_tree_of(position, pieces, number, {a, b, c});
        const auto& brick = bricks_[number];
        if (brick == nullptr) continue;
        const BoundingCylinder& bounds = brick->nodes.front().bounds;
        leaves.push_back({bounds, ~static_cast<std::int32_t>(top_leaves_.size())});
        top_leaves_.push_back(brick.get());
        pieces_ += (brick->nodes.size() + 1) / 2;
        for (int axis = 0; axis < 3; ++axis) {
          const Extent extent = extent_of(bounds, Eigen::Vector3d::Zero(), Eigen::Vector3d::Unit(axis));
          low_[axis] = std::min(low_[axis], extent.low);
          high_[axis] = std::max(high_[axis], extent.high);
        }
      }
  top_ = tree_of(std::move(leaves));
}

std::size_t SurfaceTree::bytes() const {
  std::size_t nodes = top_.size();
  for (const BrickTree* brick : top_leaves_) nodes += brick->nodes.size();
  return nodes * sizeof(TreeNode) + bricks_.size() * sizeof(bricks_.front()) +
         top_leaves_.size() * sizeof(top_leaves_.front());
}

std::optional<NearestSurfacePoint> SurfaceTree::nearest(const Point<Patient>& x, double within_mm) const {
  if (top_.empty() || !x.all_finite()) return {};
  struct Waiting {
    const TreeNode* node;
    const TreeNode* nodes;  // array that its child indices refer to
    double min_mm;
  };
  // one sibling is pending at every level of both trees
  constexpr std::size_t kDeepest = 96;
  std::array<Waiting, kDeepest> waiting;
  std::size_t count = 0;
  const PositionReader position(surface_->distance_field());
  Point<Patient> best_position;
  bool found = false;
  const bool inside = surface_->distance_mm(x) < 0;
  double best_mm = inside ? std::numeric_limits<double>::infinity() : within_mm;
  waiting[count++] = {top_.data(), top_.data(), min_mm(top_.front().bounds, x.eigen())};
  for (int visited = 0; count > 0 && visited < kMaxNodes; ++visited) {
    const Waiting now = waiting[--count];
    if (!(now.min_mm < (found ? best_mm - kSlack_mm : best_mm))) continue;
    const TreeNode& node = *now.node;
    if (node.first >= 0) {
      const TreeNode* const a = now.nodes + node.first;
      const TreeNode* const b = a + 1;
      const double a_mm = min_mm(a->bounds, x.eigen()), b_mm = min_mm(b->bounds, x.eigen());
      // the nearer child is visited first
      const bool swap = a_mm < b_mm;
      waiting[count++] = {swap ? b : a, now.nodes, swap ? b_mm : a_mm};
      waiting[count++] = {swap ? a : b, now.nodes, swap ? a_mm : b_mm};
    } else if (now.nodes == top_.data()) {
      const TreeNode* const brick = top_leaves_[static_cast<std::size_t>(~node.first)]->nodes.data();
      waiting[count++] = {brick, brick, now.min_mm};
    } else {
      Point<Patient> here(middle_of(node.bounds));
      double here_mm = (x - here).norm();
      if (now.min_mm < here_mm - kSlack_mm) here_mm = refine_nearest(position, x, here);
      if (!(here_mm < best_mm)) continue;
      best_mm = here_mm;
      best_position = here;
      found = true;
    }
  }
  if (!found) return {};
  return NearestSurfacePoint{inside ? -best_mm : best_mm, best_position};
}

Vector<Patient> SurfaceTree::outward(const Point<Patient>& x, const NearestSurfacePoint& near) const {
  // closer than this, the direction to the nearest point is dominated by its error
  constexpr double kReliable_mm = 0.3;
  const double away_mm = std::abs(near.distance_mm);
  const Vector<Patient> direction =
      near.distance_mm < 0 ? (near.position - x).normalized() : (x - near.position).normalized();
  if (away_mm >= kReliable_mm) return direction;
  const double fraction = away_mm / kReliable_mm;
  return (direction * fraction + surface_->outward(near.position) * (1 - fraction)).normalized();
}

}  // namespace palpate
