#include "palpate/tissue/displacement_field.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "palpate/base/check.h"
#include "tissue/trilinear_weights.h"

namespace palpate {
namespace {

// Distance that the field is continued into empty nodes, per displacement: limits the slope to 1/3, so that
// nothing folds.
constexpr double kExtrapolationPerDisplacement = 3;
constexpr int kMinExtrapolatedLayers = 4, kMaxExtrapolatedLayers = 24;

}  // namespace

DisplacementField::DisplacementField(const ElasticBox& box, std::vector<Eigen::Vector3f> displacement_mm,
                                     const std::vector<bool>& empty, double fade_cells)
    : box_(box), fade_cells_(fade_cells), displacement_mm_(std::move(displacement_mm)) {
  PALPATE_CHECK(displacement_mm_.size() == node(box_, 0, 0, box_.cells[2] + 1) &&
                empty.size() == displacement_mm_.size() && fade_cells_ > 0);
  extrapolate_into_empty_nodes(empty);
}

// Layer by layer, empty nodes take the mean of their known neighbours, scaled down with each layer.
void DisplacementField::extrapolate_into_empty_nodes(const std::vector<bool>& empty) {
  const auto& cells = box_.cells;
  float max_mm = 0;
  for (const Eigen::Vector3f& moved : displacement_mm_) max_mm = std::max(max_mm, moved.norm());
  const int layers =
      std::clamp(static_cast<int>(std::ceil(kExtrapolationPerDisplacement * max_mm / box_.cell_mm)),
                 kMinExtrapolatedLayers, kMaxExtrapolatedLayers);
  struct Node {
    int i, j, k;
  };
  std::vector<bool> known(displacement_mm_.size());
  std::vector<Node> edge;
  for (int k = 0; k <= cells[2]; ++k)
    for (int j = 0; j <= cells[1]; ++j)
      for (int i = 0; i <= cells[0]; ++i) {
        if (empty[node(box_, i, j, k)]) continue;
        known[node(box_, i, j, k)] = true;
        edge.push_back({i, j, k});
      }
  std::vector<Eigen::Vector3f> whole_mm = displacement_mm_;
  std::vector<int> neighbours(displacement_mm_.size());
  for (int layer = 0; layer < layers && !edge.empty(); ++layer) {
    std::vector<Node> next;
    for (const Node& from : edge)
      for (int c = 0; c < 27; ++c) {
        const Node to{from.i + c % 3 - 1, from.j + c / 3 % 3 - 1, from.k + c / 9 - 1};
        if (to.i < 0 || to.j < 0 || to.k < 0 || to.i > cells[0] || to.j > cells[1] || to.k > cells[2])
          continue;
        const std::size_t n = node(box_, to.i, to.j, to.k);
        if (known[n]) continue;
        if (neighbours[n]++ == 0) next.push_back(to);
        whole_mm[n] += whole_mm[node(box_, from.i, from.j, from.k)];
      }
    const float fraction = 1 - static_cast<float>(layer + 1) / static_cast<float>(layers + 1);
    for (const Node& at : next) {
      const std::size_t n = node(box_, at.i, at.j, at.k);
      known[n] = true;
      whole_mm[n] /= static_cast<float>(neighbours[n]);
      displacement_mm_[n] = fraction * whole_mm[n];
    }
    edge = std::move(next);
  }
}

void DisplacementField::add_displacement(const Point<Patient>& at_rest, Vector<Patient>& to_mm) const {
  const Eigen::Vector3d in_cells = box_.local_mm(at_rest) / box_.cell_mm;
  double fraction = 1;
  for (int axis = 0; axis < 3; ++axis) {
    const double beyond = std::max({-in_cells[axis], in_cells[axis] - box_.cells[axis], 0.0}) / fade_cells_;
    // negated comparison: also rejects non-finite values
    if (!(beyond < 1)) return;
    fraction *= 1 - beyond;
  }
  Eigen::Vector3d moved = Eigen::Vector3d::Zero();
  TrilinearWeights(in_cells, box_.cells).corners([&](int i, int j, int k, double weight) {
    moved += weight * at(i, j, k).cast<double>();
  });
  to_mm += Vector<Patient>(box_.axes * moved) * fraction;
}

}  // namespace palpate
