#include "palpate/rehearsal/structure_distance.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

#include "palpate/surfaces/surfaces.h"
#include "rehearsal/labels_with_voxels.h"

namespace palpate {
namespace {

constexpr double kBlock_mm = 8;      // edge of the cubes by which intersection points are grouped
constexpr double kMinNear_mm = 0.5;  // lower bound of near_mm()

// intersections of the surface with grid edges, with linear interpolation along each edge
std::vector<Eigen::Vector3f> edge_cuts(const SignedField& position, double max_gradient) {
  std::vector<Eigen::Vector3f> cuts;
  const Bricks<std::int16_t>& voxels = position.bricks();
  const SignedSteps& steps = position.steps();
  const auto X = position.geometry().X_PatientVoxel();
  const auto value_mm = [&](std::int16_t stored) { return steps.offset + steps.scale * stored; };
  const double max_mm = 1.01 * std::max(1.0, max_gradient) * position.geometry().spacing_mm.maxCoeff();
  voxels.for_each_piece([&](const RowPiece<std::int16_t>& piece) {
    if (piece.uniform) return;
    for (int n = 0; n < piece.count; ++n) {
      const double here_mm = value_mm(piece.voxels[n]);
      if (std::abs(here_mm) > max_mm) continue;
      for (int axis = 0; axis < 3; ++axis) {
        std::array<int, 3> beside{piece.i + n, piece.j, piece.k};
        ++beside[static_cast<std::size_t>(axis)];
        const double there_mm = value_mm(voxels.anywhere(beside[0], beside[1], beside[2]));
        if ((here_mm <= 0) == (there_mm <= 0)) continue;
        Point<Voxel> cut(piece.i + n, piece.j, piece.k);
        cut[axis] += here_mm / (here_mm - there_mm);
        cuts.push_back((X * cut).eigen().cast<float>());
      }
    }
  });
  return cuts;
}

}  // namespace

double StructureDistance::Block::squared_mm2(const Eigen::Array3d& at) const {
  return (low - at).max(at - high).max(Eigen::Array3d::Zero()).square().sum();
}

StructureDistance::StructureDistance(LabelId label, std::shared_ptr<const Surface> surface)
    : label_(label), surface_(std::move(surface)) {
  // closer to the reach, a cell may have corners beyond it
  near_mm_ =
      std::max(kMinNear_mm, surface_->outside_mm() - surface_->distance_field().geometry().spacing_mm.norm());
  std::map<std::array<int, 3>, std::vector<Eigen::Vector3f>> cubes;
  for (const Eigen::Vector3f& position : edge_cuts(surface_->distance_field(), surface_->max_gradient())) {
    const Eigen::Array3f cube = (position.array() / static_cast<float>(kBlock_mm)).floor();
    cubes[{static_cast<int>(cube[0]), static_cast<int>(cube[1]), static_cast<int>(cube[2])}].push_back(
        position);
  }
  for (const auto& [cube, samples] : cubes) {
    Block block{Eigen::Array3d::Constant(std::numeric_limits<double>::infinity()),
                Eigen::Array3d::Constant(-std::numeric_limits<double>::infinity()),
                static_cast<std::uint32_t>(edge_points_.size()), static_cast<std::uint32_t>(samples.size())};
    for (const Eigen::Vector3f& at_position : samples) {
      block.low = block.low.min(at_position.cast<double>().array());
      block.high = block.high.max(at_position.cast<double>().array());
    }
    blocks_.push_back(block);
    edge_points_.insert(edge_points_.end(), samples.begin(), samples.end());
  }
}

double StructureDistance::distance_mm(const Point<Patient>& at) const {
  const double own_mm = surface_->distance_mm(at);
  if (std::abs(own_mm) < near_mm_ || blocks_.empty()) return own_mm;
  return std::copysign(to_edge_cuts_mm(at.eigen()), own_mm);
}

double StructureDistance::to_edge_cuts_mm(const Eigen::Vector3d& at) const {
  double min_mm2 = std::numeric_limits<double>::infinity();
  const auto look_in = [&](const Block& block) {
    for (std::uint32_t n = block.first; n < block.first + block.count; ++n)
      min_mm2 = std::min(min_mm2, (edge_points_[n].cast<double>() - at).squaredNorm());
  };
  // the nearest block first, because its result prunes most of the others
  const Block* nearest = &blocks_.front();
  double nearest_mm2 = nearest->squared_mm2(at.array());
  for (const Block& block : blocks_) {
    const double mm2 = block.squared_mm2(at.array());
    if (mm2 < nearest_mm2) nearest = &block, nearest_mm2 = mm2;
  }
  look_in(*nearest);
  for (const Block& block : blocks_)
    if (&block != nearest && block.squared_mm2(at.array()) < min_mm2) look_in(block);
  return std::sqrt(min_mm2);
}

Result<std::vector<StructureDistance>> structure_distances(const Model& model, const Progress& progress,
                                                           const std::vector<bool>& only) {
  std::vector<bool> has_voxel = labels_with_voxels(model);
  if (!only.empty())
    for (std::size_t label = 0; label < has_voxel.size(); ++label)
      has_voxel[label] = has_voxel[label] && label < only.size() && only[label];
  std::map<LabelId, std::shared_ptr<const Surface>> surfaces;
  for (std::size_t n = 0; n < model.label_of_surface.size() && n < model.surfaces.size(); ++n)
    if (model.surfaces[n].surface != nullptr)
      surfaces.emplace(model.label_of_surface[n], model.surfaces[n].surface);
  std::vector<LabelId> missing;
  for (const Segment& segment : model.segments)
    if (segment.id != 0 && has_voxel[segment.id] && !surfaces.contains(segment.id))
      missing.push_back(segment.id);
  if (!missing.empty()) {
    const auto prepared = prepare_each_surface(
        *model.labels, missing, {},
        [&](PreparedSurface made) {
          surfaces.emplace(made.label, std::make_shared<const Surface>(std::move(made.surface)));
        },
        progress);
    if (!prepared) return prepared.error();
  }
  std::vector<StructureDistance> distances;
  for (const Segment& segment : model.segments) {
    if (progress.stopped()) return Progress::interrupted();
    const auto found = surfaces.find(segment.id);
    if (found != surfaces.end() && has_voxel[segment.id]) distances.emplace_back(segment.id, found->second);
  }
  return distances;
}

}  // namespace palpate
