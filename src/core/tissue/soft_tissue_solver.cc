#include "palpate/tissue/soft_tissue_solver.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "palpate/contact/bonded_layer.h"
#include "palpate/contact/tool_contact.h"
#include "palpate/tissue/elastic_contact.h"
#include "tissue/contact_prediction.h"
#include "tissue/solver_box.h"
#include "tissue/solver_region.h"
#include "tissue/supported_layer.h"

namespace palpate {
namespace {

// Blends the compliance of the surroundings towards that of a thin layer on a rigid base. The weight of
// the layer's value falls from 1 to 0 as its thickness rises from thin_layer_cells to resolved_layer_cells.
void blend_with_thin_layer(const SupportedLayer& layer, double cell_mm, LocalCompliance& local) {
  const double at_layer_mm_per_N =
      layer_base_mm_per_N(layer.thickness_mm, local.modulus_N_per_mm2, local.poissons_ratio);
  const double resolved =
      std::clamp((layer.thickness_mm / cell_mm - kSolverSettings.thin_layer_cells) /
                     (kSolverSettings.resolved_layer_cells - kSolverSettings.thin_layer_cells),
                 0.0, 1.0);
  local.surroundings_mm_per_N = (1 - resolved) * at_layer_mm_per_N + resolved * local.surroundings_mm_per_N;
  local.surroundings_per_compliance *= resolved;
}

// Distance from a point in the box to its faces along a unit direction.
double to_face_mm(const ElasticBox& box, const Point<Patient>& at, const Vector<Patient>& along) {
  const Eigen::Vector3d start = box.local_mm(at), step = box.local_mm(at + along) - start;
  double nearest_mm = std::numeric_limits<double>::infinity();
  for (int axis = 0; axis < 3; ++axis) {
    if (step[axis] == 0) continue;
    const double face_mm = step[axis] > 0 ? box.cells[static_cast<std::size_t>(axis)] * box.cell_mm : 0;
    nearest_mm = std::min(nearest_mm, (face_mm - start[axis]) / step[axis]);
  }
  return nearest_mm;
}

// Corrects the compliance for a rigid structure below the box. The springs at the box's faces assume a
// half-space of tissue there.
void add_deep_base_compliance(const CarvedLabels& labels, std::span<const ElasticMaterial> by_label,
                              const ElasticBox& box, const PredictedContact& contact,
                              LocalCompliance& local) {
  const double depth_in_box_mm = to_face_mm(box, contact.at, -contact.outward);
  const double per_mm = mean_inverse_base_depth_per_mm(labels, by_label, contact.at, contact.outward,
                                                       depth_in_box_mm, kSolverSettings.max_base_depth_mm);
  if (per_mm > 0)
    local.surroundings_mm_per_N +=
        layer_base_mm_per_N(1 / per_mm, local.modulus_N_per_mm2, local.poissons_ratio);
}

}  // namespace

std::uint64_t ticks_of_solver_frame(double rate_hz) {
  return std::max<std::uint64_t>(1, static_cast<std::uint64_t>(std::floor(rate_hz * kSolverFrame_s + 0.5)));
}

double default_solver_cell_mm(TissueLaw law, double voxel_mm, std::span<const Tool> tools) {
  const double largest_mm = kSolverSettings.max_cell_voxels * voxel_mm;
  double radius_mm = 0;
  for (const Tool& tool : tools) {
    radius_mm = std::max(radius_mm, tool.radius_mm);
    for (const ToolCapsule& capsule : tool.capsules) radius_mm = std::max(radius_mm, capsule.radius_mm);
  }
  const double cell_for_reach_mm = kSolverSettings.box_radii * radius_mm / kSolverSettings.cells_across;
  return std::clamp(is_hyperelastic(law) ? largest_mm : std::clamp(cell_for_reach_mm, voxel_mm, largest_mm),
                    kSolverSettings.min_cell_mm, kSolverSettings.max_cell_mm);
}

double solver_cell_mm(const Model& model) {
  const double base_mm =
      model.tissue_cell_mm > 0
          ? model.tissue_cell_mm
          : default_solver_cell_mm(model.tissue_law, model.labels->geometry().min_spacing_mm(), model.tools);
  return base_mm * model.tissue_cell_factor;
}

std::optional<SolverBox> next_solver_box(const Model& model, const DeviceTick& device,
                                         const std::optional<SolverBox>& before) {
  const auto contact = expected_contact(model, device);
  if (!contact) return before;
  const Eigen::Vector3d centre = solver_box_centre(model, contact->at, contact->outward);
  if (before && box_covers(model, before->first_cell, centre)) return before;
  return SolverBox{first_cell_around(model, centre), contact->at};
}

/// Frame between two steps, and its state for the current device.
struct SoftTissueSolver::FrameInProgress {
  const Model& model;
  const TickRecord tick;
  const std::vector<ElasticMaterial> by_label;
  const CarvedLabels labels;

  std::size_t device = 0;
  enum class Stage : std::uint8_t { kRegion, kPreparation, kIterations } stage = Stage::kRegion;
  // predicted contact, on a surface with this outward unit normal
  Point<Patient> at;
  Vector<Patient> outward;
  double force_N = 0;           ///< SoftTissueSolver::displacing_force_N
  bool is_first_solve = false;  ///< The first in the device's region
  double depth_mm = 0;          ///< Predicted depth
  double rho_mm = 0;            ///< Radius of the patch
  PressurePatch patch;
  std::optional<SupportedLayer> layer;

  FrameInProgress(const Model& of, const TickRecord& from)
      : model(of), tick(from), by_label(materials_of(of)), labels(carved_labels(of)) {}
  void next_device() {
    ++device;
    stage = Stage::kRegion;
  }
};

SoftTissueSolver::SoftTissueSolver() = default;
SoftTissueSolver::~SoftTissueSolver() = default;

const ComplianceFrame& SoftTissueSolver::solve(const Model& model, const TickRecord& tick) {
  begin_frame(model, tick);
  while (!step()) {
  }
  return frame_;
}

void SoftTissueSolver::begin_frame(const Model& model, const TickRecord& tick) {
  frame_.number += 1;
  in_progress_ = std::make_unique<FrameInProgress>(model, tick);
}

bool SoftTissueSolver::step() {
  using Stage = FrameInProgress::Stage;
  if (in_progress_ == nullptr) return true;
  FrameInProgress& now = *in_progress_;
  while (now.device < kMaxDevices) {
    std::unique_ptr<Region>& region = regions_[now.device];
    switch (now.stage) {
      case Stage::kRegion: {
        const Region* const before = region.get();
        if (!place_region(now)) {
          now.next_device();
          break;
        }
        now.stage = Stage::kPreparation;
        if (region.get() != before) return false;
        break;
      }
      case Stage::kPreparation:
        if (!region->solver.prepare()) return false;
        if (begin_patch_solve(now)) {
          now.stage = Stage::kIterations;
          return false;
        }
        finish_patch_solve(now);
        now.next_device();
        break;
      case Stage::kIterations:
        if (!region->solver.iterate(region->unit_mm)) return false;
        finish_patch_solve(now);
        now.next_device();
        break;
    }
  }
  in_progress_.reset();
  return true;
}

// Predicts the device's contact and places its region there. Returns whether there is one.
bool SoftTissueSolver::place_region(FrameInProgress& now) {
  const Model& model = now.model;
  const DeviceTick& device = now.tick.device[now.device];
  // computed first, because it reads the previous frame's local compliance
  now.force_N = displacing_force_N(now.device, device);
  frame_.local_compliance[now.device] = {};
  if (now.device >= static_cast<std::size_t>(now.tick.devices)) return false;
  const auto contact = expected_contact(model, device);
  if (!contact) return false;
  now.at = contact->at;
  now.outward = contact->outward;

  std::unique_ptr<Region>& region = regions_[now.device];
  const bool same = region != nullptr && region->was_made_from(model, now.labels, now.by_label);
  if (same) region->follow(now.labels);
  const Eigen::Vector3d centre = solver_box_centre(model, now.at, now.outward);
  if (!same || !box_covers(model, region->box.first_cell, centre))
    region = std::make_unique<Region>(model, now.by_label,
                                      SolverBox{first_cell_around(model, centre), now.at}, region.get());
  return true;
}

// Places the patch, and begins the linear solution under it. Returns whether there is one.
bool SoftTissueSolver::begin_patch_solve(FrameInProgress& now) {
  const DeviceTick& device = now.tick.device[now.device];
  Region& region = *regions_[now.device];
  LocalCompliance& local = frame_.local_compliance[now.device];
  now.is_first_solve = std::exchange(region.needs_first_solve, false);

  const double cell_mm = region.grid().box().cell_mm;
  const double radius_mm =
      std::max(now.model.tool_of(now.device).radius_mm, kSoftTissueSettings.min_radius_mm);
  region.radius_mm = radius_mm;
  region.max_N_per_mm = max_deformable_stiffness_N_per_mm(now.model);
  const double min_mm = kSolverSettings.min_patch_cells * cell_mm;
  if (!(region.modulus_N_per_mm2 > 0))
    region.modulus_N_per_mm2 =
        PressurePatch(region.grid(), now.at, now.outward, min_mm).contact_modulus_N_per_mm2();
  now.depth_mm = expected_depth_mm(device, {now.at, now.outward}, radius_mm);
  const double contact_radius_mm =
      region.modulus_N_per_mm2 > 0
          ? radius_at_depth_mm(device, now.force_N, now.depth_mm, radius_mm, region.modulus_N_per_mm2)
          : 0;
  now.rho_mm =
      std::clamp(contact_radius_mm, min_mm, kMaxPatchRadiusFraction * region.grid().box().cells[1] * cell_mm);
  now.patch = PressurePatch(region.grid(), now.at, now.outward, now.rho_mm);
  now.layer = supported_layer(now.labels, now.by_label, now.at, now.outward,
                              std::max(contact_radius_mm, 0.5 * cell_mm),
                              kSolverSettings.resolved_layer_cells * cell_mm);
  local.at = now.at;
  local.patch_radius_mm = now.rho_mm;
  if (now.layer) {
    const ElasticConstants constants{now.layer->material.youngs_modulus_kPa,
                                     now.layer->material.poissons_ratio};
    local.modulus_N_per_mm2 = contact_modulus_N_per_mm2(constants);
    local.poissons_ratio = constants.poissons_ratio;
  }
  region.modulus_N_per_mm2 = now.patch.contact_modulus_N_per_mm2();
  if (!now.patch.touches()) return false;
  std::fill(region.load_N.values.begin(), region.load_N.values.end(), 0.0f);
  now.patch.add(1, region.load_N);
  region.solver.begin_solve(
      region.load_N, region.unit_mm,
      now.is_first_solve ? kSolverSettings.first_iterations : kSolverSettings.iterations, kLinearTolerance);
  return true;
}

// Computes the device's local compliance from the linear solution, if there is one.
void SoftTissueSolver::finish_patch_solve(FrameInProgress& now) {
  Region& region = *regions_[now.device];
  LocalCompliance& local = frame_.local_compliance[now.device];
  const double cell_mm = region.grid().box().cell_mm;
  if (now.patch.touches()) {
    local.compliance_mm_per_N = now.patch.displacement_mm(region.unit_mm);
    // W = J K^-1 J^T: the patch both applies the load and measures the displacement, hence the factor of 2
    local.gradient_per_N = now.patch.gradient_along_surface(region.unit_mm) * 2;
    if (!now.layer) {
      local.modulus_N_per_mm2 = region.modulus_N_per_mm2;
      local.poissons_ratio = now.patch.poissons_ratio();
    }
  }
  if (local.is_known()) {
    local.compute_surroundings();
    add_deep_base_compliance(now.labels, now.by_label, region.grid().box(), {now.at, now.outward}, local);
    if (now.layer) blend_with_thin_layer(*now.layer, cell_mm, local);
  } else if (now.layer) {
    // the layer is thinner than a cell, so that all nodes of the cell are constrained
    blend_with_thin_layer(*now.layer, cell_mm, local);
    local.gradient_per_N = {};
    local.compliance_mm_per_N = patch_compliance_mm_per_N(local.surroundings_mm_per_N, now.rho_mm,
                                                          local.modulus_N_per_mm2, local.poissons_ratio);
    // the cells contribute nothing to the displacement
    if (const Tissue* const tissue = now.model.tissue_of(now.layer->label))
      local.relaxed.add(tissue->relaxation, now.model.relaxation_times, 1);
    return;
  } else {
    local = {};
    return;
  }
  if (region.neo_hookean != nullptr)
    region.solve_neo_hookean(now.patch, now.depth_mm, now.is_first_solve, local);
  if (region.relaxation_weights) {
    const RelaxationWeights::Means means = region.relaxation_weights->under(region.grid(), region.unit_mm);
    local.relaxed = means.relaxed;
    local.strain_stiffening = means.stiffening;
  }
}

void SoftTissueSolver::resume(const Model& model, std::uint32_t frame,
                              std::span<const std::optional<SolverBox>> boxes) {
  frame_ = {};
  frame_.number = frame;
  const std::vector<ElasticMaterial> by_label = materials_of(model);
  const CarvedLabels labels = carved_labels(model);
  for (std::size_t d = 0; d < kMaxDevices; ++d) {
    std::unique_ptr<Region>& region = regions_[d];
    if (d >= boxes.size() || !boxes[d]) {
      region.reset();
    } else if (region == nullptr || region->box != *boxes[d] ||
               !region->was_made_from(model, labels, by_label) || !region->is_up_to_date(labels)) {
      region = std::make_unique<Region>(model, by_label, *boxes[d], nullptr);
      while (!region->solver.prepare()) {
      }
    }
    if (region != nullptr) region->needs_first_solve = true;
  }
}

void SoftTissueSolver::restart(std::uint32_t frame) noexcept {
  frame_ = {};
  frame_.number = frame;
  in_progress_.reset();
  for (std::unique_ptr<Region>& region : regions_) region.reset();
}

bool SoftTissueSolver::field_of(std::size_t device, UnitDisplacementField& field) const {
  const Region* region = device < regions_.size() ? regions_[device].get() : nullptr;
  if (region == nullptr || !frame_.local_compliance[device].is_known()) return false;
  field = {&region->grid().box(), &region->grid().layout(), &region->unit_mm};
  return true;
}

double SoftTissueSolver::displacing_force_N(std::size_t device, const DeviceTick& device_tick) const {
  const Region* region = device < regions_.size() ? regions_[device].get() : nullptr;
  if (region == nullptr || !region->relaxation_weights || !frame_.local_compliance[device].is_known())
    return device_tick.contact_N[0];
  return instantaneous_force_N(device_tick, contact_law_of(frame_.local_compliance[device]),
                               region->radius_mm, region->max_N_per_mm);
}

bool VirtualClockSoftTissueSolver::advance(const Model& model, const TickRecord* before) {
  if (before == nullptr || before->tick % ticks_ != 0) return false;
  const bool is_published = solver_.frame().number > frame_.number;
  if (is_published) {
    frame_ = solver_.frame();
    input_tick_ = solved_from_;
  }
  solver_.solve(model, *before);
  solved_from_ = before->tick;
  return is_published;
}

bool VirtualClockSoftTissueSolver::publish_pending() {
  if (solver_.frame().number == frame_.number) return false;
  frame_ = solver_.frame();
  input_tick_ = solved_from_;
  return true;
}

}  // namespace palpate
