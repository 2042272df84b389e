#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/scene/structures.h"
#include "palpate/tasks/task.h"

namespace palpate {
namespace {

constexpr std::array<std::array<int, 3>, 6> kFaces{
    {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}}};
/// Calls visit(i, j, k, position_mm) for every voxel of the given labels.
template <class Visit>
void for_each_voxel(const Bricks<LabelId>& labels, const std::vector<bool>& has, const Visit& visit) {
  const auto X = labels.geometry().X_PatientVoxel();
  labels.for_each_piece([&](const auto& piece) {
    if (piece.uniform && !(piece.voxels[0] < has.size() && has[piece.voxels[0]])) return;
    for (int n = 0; n < piece.count; ++n)
      if (piece.voxels[n] < has.size() && has[piece.voxels[n]])
        visit(piece.i + n, piece.j, piece.k, (X * Point<Voxel>(piece.i + n, piece.j, piece.k)).eigen());
  });
}

std::optional<Eigen::Vector3d> centroid(const Bricks<LabelId>& labels, const std::vector<bool>& has) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  std::size_t count = 0;
  for_each_voxel(labels, has, [&](int, int, int, const Eigen::Vector3d& position) {
    sum += position;
    ++count;
  });
  return count ? std::optional<Eigen::Vector3d>(sum / static_cast<double>(count)) : std::nullopt;
}

Eigen::Vector3d farthest(const Bricks<LabelId>& labels, const std::vector<bool>& has,
                         const Eigen::Vector3d& direction) {
  // the mean of all extreme voxels, so that the result does not depend on their order
  double largest = -std::numeric_limits<double>::infinity();
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double count = 0;
  for_each_voxel(labels, has, [&](int, int, int, const Eigen::Vector3d& position) {
    const double far = position.dot(direction);
    if (far > largest + 1e-6) {
      largest = far;
      sum.setZero();
      count = 0;
    }
    if (far > largest - 1e-6) {
      sum += position;
      ++count;
    }
  });
  return sum / count;
}

const Surface* surface_of(const Model& model, LabelId label) {
  for (std::size_t n = 0; n < model.label_of_surface.size() && n < model.surfaces.size(); ++n)
    if (model.label_of_surface[n] == label) return model.surfaces[n].surface.get();
  return nullptr;
}

/// Suggested view of the voxels of some structures within bounds.
template <class Bounds>
RegionView view_of_part(const Model& model, const std::vector<bool>& has, const Bounds& bounds) {
  RegionView view;
  const Bricks<LabelId>& labels = *model.labels;
  const Eigen::Matrix3d axes = labels.geometry().direction * labels.geometry().spacing_mm.asDiagonal();
  const auto is_free = [&](LabelId label) {
    const Tissue* const tissue = label == 0 ? nullptr : model.tissue_of(label);
    return tissue == nullptr || !tissue->touchable;
  };
  Eigen::Vector3d sum = Eigen::Vector3d::Zero(), outward = Eigen::Vector3d::Zero();
  double count = 0, faces = 0;
  for_each_voxel(labels, has, [&](int i, int j, int k, const Eigen::Vector3d& position) {
    if (!bounds(position)) return;
    sum += position;
    ++count;
    for (const auto& face : kFaces) {
      const LabelId beside = labels.anywhere(i + face[0], j + face[1], k + face[2]);
      if ((beside < has.size() && has[beside]) || !is_free(beside)) continue;
      const Eigen::Vector3d out = axes * Eigen::Vector3d(face[0], face[1], face[2]);
      // weighted by the face area, which is the voxel volume divided by its height
      outward += out / out.squaredNorm();
      faces += 1 / out.norm();
    }
  });
  if (count == 0) return view;
  view.centre_mm = sum / count;
  for_each_voxel(labels, has, [&](int, int, int, const Eigen::Vector3d& at_position) {
    if (bounds(at_position)) view.radius_mm = std::max(view.radius_mm, (at_position - view.centre_mm).norm());
  });
  // normals of a closed surface cancel out
  constexpr double kMinFraction = 0.05;
  if (outward.norm() > kMinFraction * faces) view.outward = outward.normalized();
  return view;
}

/// Resolves the plan of a task. Errors: no tool that cuts, absent structures, an empty region.
Result<TaskPlan> resolve_task_plan(const TaskFile& task, const Model& model, const Progress& progress) {
  if (!model.has_burr())
    return Error{ErrorKind::kBadInput, "the task removes tissue, but no tool of the scene can cut",
                 task.source, "give the scene a burr or shaver as its [tool], docs/guide/scene.md"};
  auto plan = resolve_plan(*task.plan, model);
  if (!plan) return plan.error();
  const auto planned = planned_volumes(*plan, model, progress);
  if (!planned) return planned.error();
  TaskPlan found{*std::move(plan), {}, RemovalFollower(model), model.tool_of(0), model.X_WorldPatient};
  for (std::size_t n = 0; n < found.plan.regions.size(); ++n) {
    double mm3 = 0;
    for (const auto& [label, part_mm3] : planned->of_regions[n]) mm3 += part_mm3;
    const PlanRegion& region = found.plan.file.regions[n];
    if (mm3 == 0)
      return Error{ErrorKind::kBadInput, "nothing removable lies in region \"" + region.name + "\"",
                   found.plan.file.where(region.line), "move or widen it, or name other structures"};
    found.planned_mm3.push_back(mm3);
  }
  return found;
}

// adds the faces between the region's structures and other labels, sampled at most half a patch apart and
// projected onto the smooth contact surface
void add_patches(const Model& model, RegionInScene& region) {
  const Bricks<LabelId>& labels = *model.labels;
  const GridGeometry& grid = labels.geometry();
  const Eigen::Matrix3d axes = grid.direction * grid.spacing_mm.asDiagonal();
  for_each_voxel(labels, region.has_label, [&](int i, int j, int k, const Eigen::Vector3d& position) {
    const LabelId own = labels.at(i, j, k);
    for (const auto& face : kFaces) {
      if (region.has(labels.anywhere(i + face[0], j + face[1], k + face[2]))) continue;
      const int axis = face[0] ? 0 : face[1] ? 1 : 2;
      const Eigen::Vector3d out = axes * Eigen::Vector3d(face[0], face[1], face[2]);
      const Eigen::Vector3d u = axes.col((axis + 1) % 3), v = axes.col((axis + 2) % 3);
      const auto parts = [](const Eigen::Vector3d& edge) {
        return std::max(1, static_cast<int>(std::ceil(2 * edge.norm() / SurfacePatches::kEdge_mm)));
      };
      const int nu = parts(u), nv = parts(v);
      const Surface* surface = surface_of(model, own);
      for (int a = 0; a < nu; ++a) {
        for (int b = 0; b < nv; ++b) {
          Eigen::Vector3d at = position + 0.5 * out + ((a + 0.5) / nu - 0.5) * u + ((b + 0.5) / nv - 0.5) * v;
          for (int turn = 0; surface && turn < 2; ++turn) {
            const double off_mm = surface->distance_mm(Point<Patient>(at));
            if (std::abs(off_mm) < 2) at -= off_mm * surface->outward(Point<Patient>(at)).eigen();
          }
          if (region.contains_point(at)) region.patches.add(at);
        }
      }
    }
  });
}

}  // namespace

bool RegionInScene::contains_point(const Eigen::Vector3d& position_mm) const {
  if (centre_mm && !((position_mm - *centre_mm).norm() <= radius_mm)) return false;
  return std::all_of(planes.begin(), planes.end(), [&](const Plane& plane) {
    return (position_mm - plane.point_mm).dot(plane.normal) >= 0;
  });
}

RegionView view_of(const RegionInScene& region, const Model& model) {
  if (region.has_label.empty())
    return {region.centre_mm.value_or(Eigen::Vector3d::Zero()), region.radius_mm, Eigen::Vector3d::Zero()};
  return view_of_part(model, region.has_label,
                      [&](const Eigen::Vector3d& position) { return region.contains_point(position); });
}

RegionView view_of(const RegionInPlan& region, const Model& model) {
  std::vector<bool> has(model.tissue_of_label.size());
  for (std::size_t label = 1; label < has.size(); ++label)
    has[label] = region.has(static_cast<LabelId>(label)) && model.is_touchable(static_cast<LabelId>(label));
  return view_of_part(model, has, [&](const Eigen::Vector3d& position) {
    return region.depth_mm(Point<Patient>(position)) > 0;
  });
}

Result<TaskInScene> resolve_task(const TaskFile& task, const Model& model, const Progress& progress) {
  const auto labels_of = [&](const std::vector<LabelReference>& structures, int line) {
    return labels_in_model(model, structures, task.where(line));
  };
  TaskInScene found{task, {}, {}, {}, {}, {}, {}, {}, {}, {}, {}};
  for (std::size_t n = 0; n < task.regions.size(); ++n) {
    if (progress.stopped()) return Progress::interrupted();
    const TaskRegion& definition = task.regions[n];
    RegionInScene region;
    auto labels = labels_of(definition.structures, definition.line);
    if (!labels) return labels.error();
    region.has_label = *std::move(labels);
    region.radius_mm = definition.radius_mm.value_or(0);
    if (definition.point) region.centre_mm = definition.point->eigen();
    if (!definition.structures.empty()) {
      const auto middle = centroid(*model.labels, region.has_label);
      if (!middle)
        return Error{ErrorKind::kBadInput,
                     "the structures of region \"" + definition.name + "\" have no voxel",
                     task.where(definition.line), "give others"};
      if (definition.landmark)
        region.centre_mm = farthest(*model.labels, region.has_label, definition.landmark->eigen());
      if (definition.half) region.planes.push_back({*middle, definition.half->eigen()});
    }
    if (definition.plane_point)
      region.planes.push_back({definition.plane_point->eigen(), definition.plane_normal->eigen()});
    const bool is_covered = std::any_of(task.steps.begin(), task.steps.end(), [&](const TaskStep& step) {
      return step.kind == StepKind::kCover && step.region == n;
    });
    if (is_covered) {
      add_patches(model, region);
      if (region.patches.count() == 0)
        return Error{ErrorKind::kBadInput,
                     "none of its structures lies in region \"" + definition.name + "\"",
                     task.where(definition.line), "move its place, or widen its radius"};
    }
    found.regions.push_back(std::move(region));
  }
  const auto add = [&](const auto& parts, std::vector<std::vector<bool>>& to) -> Result<void> {
    for (const auto& part : parts) {
      auto labels = labels_of(part.structures, part.line);
      if (!labels) return labels.error();
      to.push_back(*std::move(labels));
    }
    return {};
  };
  if (auto added = add(task.forces, found.forces); !added) return added.error();
  if (auto added = add(task.protections, found.protections); !added) return added.error();
  if (auto added = add(task.metrics, found.metrics); !added) return added.error();
  if (task.answer) {
    auto labels = labels_of(task.answer->structures, task.answer->line);
    if (!labels) return labels.error();
    found.answer_mm = centroid(*model.labels, *labels);
    if (!found.answer_mm)
      return Error{ErrorKind::kBadInput, "the structure to find has no voxel", task.where(task.answer->line),
                   "give another structure"};
    found.answer_labels = *std::move(labels);
  }
  if (task.scope) found.sight.emplace(task.scope->optics, model);
  if (task.plan) {
    auto plan = resolve_task_plan(task, model, progress);
    if (!plan) return plan.error();
    found.plan = *std::move(plan);
  }
  for (std::size_t n = 0; n < task.metrics.size(); ++n) {
    found.distances.emplace_back();
    if (!info_of(task.metrics[n].metric).needs_structures) continue;
    auto distances = structure_distances(model, progress, found.metrics[n]);
    if (!distances) return distances.error();
    if (distances->empty())
      return Error{ErrorKind::kBadInput, "the structures of a metric have no voxel",
                   task.where(task.metrics[n].line), "give others"};
    found.distances[n] = std::make_shared<const std::vector<StructureDistance>>(*std::move(distances));
  }
  if (task.microscope) found.microscope.emplace(*task.microscope, model);
  return found;
}

}  // namespace palpate
