#include "palpate/tissue/soft_tissue_solver.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "palpate/base/cube_root.h"
#include "palpate/contact/bonded_layer.h"
#include "palpate/contact/tool_contact.h"
#include "palpate/tissue/carved_cells.h"
#include "palpate/tissue/elastic_contact.h"
#include "palpate/tissue/elastic_solver.h"
#include "tissue/elastic_multigrid.h"
#include "tissue/relaxation_weights.h"
#include "tissue/solver_box.h"
#include "tissue/supported_layer.h"

namespace palpate {
namespace {

/// Residual (ElasticSolution::residual) at which linear solves stop before their maximum number of
/// iterations.
constexpr double kTolerance = 1e-4;

template <class Tagged>
Tagged from_array(const std::array<double, 3>& v) {
  return {v[0], v[1], v[2]};
}

// predicted contact point on a surface of the outermost layer, with the outward unit normal
struct PredictedContact {
  Point<Patient> at;
  Vector<Patient> outward;
};

// Nearest point on the surfaces of the outermost layer, if it is within reach_mm. The sampled distance is not
// exact away from the surface, so the point is projected along the normal several times.
std::optional<PredictedContact> project_to_surface(const Model& model, const Point<Patient>& near) {
  constexpr int kSteps = 3;
  PredictedContact found{near, {}};
  for (int step = 0; step < kSteps; ++step) {
    const Surface* nearest = nullptr;
    double distance_mm = kSolverSettings.reach_mm;
    for (const ContactSurface& surface : model.surfaces) {
      if (surface.surface == nullptr || surface.layer != 0 || surface.covered_by >= 0) continue;
      if (surface.surface->is_farther_than(found.at, std::abs(distance_mm))) continue;
      const double mm = surface.surface->distance_mm(found.at);
      if (mm >= surface.surface->outside_mm() || std::abs(mm) >= std::abs(distance_mm)) continue;
      distance_mm = mm;
      nearest = surface.surface.get();
    }
    if (nearest == nullptr) return std::nullopt;
    found.outward = nearest->outward(found.at);
    if (found.outward == Vector<Patient>()) return std::nullopt;
    found.at = found.at - found.outward * distance_mm;
  }
  return found;
}

// contact point predicted lead_frames ahead of the tick: displaced along the surface while in contact,
// otherwise nearest to the predicted tip
std::optional<PredictedContact> expected_contact(const Model& model, const DeviceTick& device) {
  const auto tip = from_array<Point<Patient>>(device.tip_patient_mm);
  Vector<Patient> displacement = from_array<Vector<Patient>>(device.velocity_patient_mm_s) *
                                 (kSolverSettings.lead_frames * kSolverFrame_s);
  if (!tip.all_finite() || !displacement.all_finite()) return std::nullopt;
  if (displacement.norm() > kSolverSettings.max_lead_mm)
    displacement = displacement.normalized() * kSolverSettings.max_lead_mm;
  if (device.contact_label[0] == 0) return project_to_surface(model, tip + displacement);
  const auto normal = from_array<Vector<Patient>>(device.normal_patient);
  const Point<Patient> position(device.contact_patient_mm[0], device.contact_patient_mm[1],
                                device.contact_patient_mm[2]);
  return project_to_surface(model, position + (displacement - normal * displacement.dot(normal)));
}

// Blends the compliance of a spot's surroundings towards that of a thin layer on a rigid base. The weight of
// the layer's value falls from 1 to 0 as its thickness rises from thin_layer_cells to resolved_layer_cells.
void blend_with_thin_layer(const SupportedLayer& layer, double cell_mm, LocalCompliance& spot) {
  const double at_layer_mm_per_N =
      layer_base_mm_per_N(layer.thickness_mm, spot.modulus_N_per_mm2, spot.poissons_ratio);
  const double resolved =
      std::clamp((layer.thickness_mm / cell_mm - kSolverSettings.thin_layer_cells) /
                     (kSolverSettings.resolved_layer_cells - kSolverSettings.thin_layer_cells),
                 0.0, 1.0);
  spot.surroundings_mm_per_N = (1 - resolved) * at_layer_mm_per_N + resolved * spot.surroundings_mm_per_N;
  spot.surroundings_per_compliance *= resolved;
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
                              const ElasticBox& box, const PredictedContact& contact, LocalCompliance& spot) {
  const double depth_in_box_mm = to_face_mm(box, contact.at, -contact.outward);
  const double per_mm = mean_inverse_base_depth_per_mm(labels, by_label, contact.at, contact.outward,
                                                       depth_in_box_mm, kSolverSettings.max_base_depth_mm);
  if (per_mm > 0)
    spot.surroundings_mm_per_N +=
        layer_base_mm_per_N(1 / per_mm, spot.modulus_N_per_mm2, spot.poissons_ratio);
}

bool presses(const DeviceTick& device) {
  return device.contact_label[0] != 0 && device.depth_mm > 0;
}

// Depth predicted lead_frames ahead of the tick, mm; not above 0: no contact. Only the increase is limited to
// max_lead_mm.
double expected_depth_mm(const DeviceTick& device, const PredictedContact& contact, double radius_mm) {
  const Vector<Patient> contact_to_tip = from_array<Point<Patient>>(device.tip_patient_mm) - contact.at;
  const double predicted_increase_mm =
      -from_array<Vector<Patient>>(device.velocity_patient_mm_s).dot(contact.outward) *
      kSolverSettings.lead_frames * kSolverFrame_s;
  const double current_depth_mm =
      presses(device) ? device.depth_mm : radius_mm - contact_to_tip.dot(contact.outward);
  return current_depth_mm + std::min(predicted_increase_mm, kSolverSettings.max_lead_mm);
}

// Contact radius at a predicted depth d. Without contact sqrt(R d) (Hertz). In contact the radius of the
// current force, (3 F R / (4 E*))^(1/3), times sqrt(d / current depth), but at most sqrt(R d): the
// displacement of the surroundings is part of the depth but does not enlarge the contact.
// @param force_N  SoftTissueSolver::displacing_force_N
double radius_at_depth_mm(const DeviceTick& device, double force_N, double depth_mm, double radius_mm,
                          double modulus_N_per_mm2) {
  if (!(depth_mm > 0)) return 0;
  const double hertz_mm = std::sqrt(radius_mm * depth_mm);
  if (!presses(device)) return hertz_mm;
  const double contact_radius_mm = cube_root(0.75 * force_N * radius_mm / modulus_N_per_mm2);
  return std::min(contact_radius_mm * std::sqrt(depth_mm / device.depth_mm), hertz_mm);
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

/// Neo-Hookean body around a device's tool (docs/decisions/archive/0039-neo-hookean-in-the-tick.md).
///
/// u1: displacement of the linear body under 1 N on the patch; W = J u1 its mean displacement there, J the
/// patch's row of the contact Jacobian (PressurePatch); f(u): nodal forces of the neo-Hookean body.
///
/// The surface under the patch is constrained to s u1, the displacement of the linear body under a force s
/// (PressurePatch::columns). All other nodes equilibrate. A displacement is prescribed, because the pressure
/// of the patch as a dead load would pinch the tissue. For small strains the solution is the linear one,
/// u = s u1.
///
/// With E(s) the energy of the body, the patch bears the force F = E'(s) / W at a displacement of s W.
/// E'(s) = u1 . f(u), summed over all nodes. A deviation e from equilibrium has zero means under the patch,
/// J e = 0. Because K u1 = J^T, u1 . K e = J e = 0 as well, so that e changes F only to second order.
///
/// Moving the patch along the surface changes J, thereby u1. At a constant s, E then changes by s (dJ) y,
/// where K y = f(u). The law's tangential force, F^2 / 2 grad W - F^3 / 3 grad C, is minus the change of E at
/// a constant depth s W, i.e. -(s (dJ) y - F s grad W). With (dJ) u1 = grad W / 2 it follows that
///
///     F^3 / 3 grad C = F (F - s) / 2 grad W + s (dJ) (y - F u1)
struct SoftTissueSolver::NeoHookeanBody {
  ElasticField correction_mm;       ///< u - s u1; its means under the patch are 0
  ElasticField excess_response_mm;  ///< y - F u1: response of the linear body to the excess forces
  ElasticField u_mm, force_N;       ///< Scratch
  double indentation_mm = 0;        ///< Displacement of the patch, s W, in the last frame; 0: none
  /// Upper limit of indentation_mm as a fraction of the patch's radius: reduced when a solution fails, raised
  /// again after each success.
  double max_indentation_ratio = kSolverSettings.max_indentation;
  double depth_mm = 0;  ///< Predicted depth of the tool in the last frame; 0: no contact
  /// Depth of a tool at rest at which a solution failed. While the tool stays there, max_indentation_ratio is
  /// not raised. 0: none.
  double failed_depth_mm = 0;
  double stiffening_mm_per_N2 = 0, reference_force_N = 0;  ///< Last published C and F (LocalCompliance)

  explicit NeoHookeanBody(const ElasticLayout& layout)
      : correction_mm(layout), excess_response_mm(layout), u_mm(layout), force_N(layout) {}
  // discards the solution; max_indentation_ratio and depth_mm are retained
  void reset() {
    for (ElasticField* field : {&correction_mm, &excess_response_mm})
      std::fill(field->values.begin(), field->values.end(), 0.0f);
    indentation_mm = stiffening_mm_per_N2 = reference_force_N = failed_depth_mm = 0;
  }
};

/// Box of cells around a device's tool, with its solver and the state from which the next frame starts. The
/// caller prepares a new region's solver.
struct SoftTissueSolver::Region {
  std::vector<ElasticMaterial> by_label;  ///< Materials that the cells were made with
  SolverBox box;
  CarvedCells cells;
  ElasticSolver solver;
  /// u1, the displacements under 1 N on the patch, and the patch's nodal forces.
  ElasticField unit_mm, load_N;
  std::optional<RelaxationWeights> relaxation_weights;  ///< Unset: no tissue relaxes or stiffens
  double modulus = 0;                                   ///< Contact modulus under the patch in the last frame
  double radius_mm = 0;                                 ///< Radius of the tool in the last frame
  /// max_deformable_stiffness_N_per_mm() in the last frame
  double max_N_per_mm = std::numeric_limits<double>::infinity();
  bool needs_first_solve = true;                ///< The next solve counts as the first one in this box
  std::unique_ptr<NeoHookeanBody> neo_hookean;  ///< null: the law is linear

  /// @param before  region that this one replaces, whose solution is reused where both overlap; may be null
  Region(const Model& model, std::vector<ElasticMaterial> materials, const SolverBox& where,
         const Region* before)
      : by_label(std::move(materials)),
        box(where),
        cells(solver_box_cells(model, by_label, where)),
        solver(ElasticSolver::unprepared([&]() -> const ElasticGrid& {
          if (before != nullptr && before->was_made_from(cells.labels(), by_label))
            cells.copy_overlap(before->cells, cell_offset_to(*before));
          return cells.grid();
        }())),
        unit_mm(cells.grid().layout()),
        load_N(cells.grid().layout()) {
    if (is_hyperelastic(model.tissue_law)) neo_hookean = std::make_unique<NeoHookeanBody>(grid().layout());
    if (before != nullptr) copy_overlap(*before);
    if (RelaxationWeights::is_needed_for(model))
      relaxation_weights.emplace(model, cells.labels(), cells.grid());
  }

  const ElasticGrid& grid() const { return cells.grid(); }
  // whether the cells were made from these labels (before removal) and materials
  bool was_made_from(const CarvedLabels& labels, const std::vector<ElasticMaterial>& materials) const {
    return labels.original == cells.labels().original && by_label == materials;
  }
  // whether the region can be used for a model: its labels, materials, law and relaxation are unchanged
  bool was_made_from(const Model& model, const CarvedLabels& labels,
                     const std::vector<ElasticMaterial>& materials) const {
    return was_made_from(labels, materials) &&
           (neo_hookean != nullptr) == is_hyperelastic(model.tissue_law) &&
           relaxation_weights.has_value() == RelaxationWeights::is_needed_for(model) &&
           (!relaxation_weights || relaxation_weights->was_made_from(model));
  }
  // whether all cells have reached the state that corresponds to the removal in `labels`
  bool is_up_to_date(const CarvedLabels& labels) const {
    return labels.removed_fraction == cells.labels().removed_fraction && cells.changing_cells().empty();
  }

  // offset that added to a cell's index in this box gives its index in the box of `other`
  std::array<int, 3> cell_offset_to(const Region& other) const {
    const auto &here = box.first_cell, &there = other.box.first_cell;
    return {here[0] - there[0], here[1] - there[1], here[2] - there[2]};
  }
  // copies the solution where both boxes overlap, as initial guess
  void copy_overlap(const Region& before) {
    if (before.grid().layout().cells != grid().layout().cells) return;
    copy_overlap(before, before.unit_mm, unit_mm);
    if (neo_hookean == nullptr || before.neo_hookean == nullptr) return;
    copy_overlap(before, before.neo_hookean->correction_mm, neo_hookean->correction_mm);
    copy_overlap(before, before.neo_hookean->excess_response_mm, neo_hookean->excess_response_mm);
    neo_hookean->indentation_mm = before.neo_hookean->indentation_mm;
    neo_hookean->max_indentation_ratio = before.neo_hookean->max_indentation_ratio;
    neo_hookean->stiffening_mm_per_N2 = before.neo_hookean->stiffening_mm_per_N2;
    neo_hookean->reference_force_N = before.neo_hookean->reference_force_N;
  }
  void copy_overlap(const Region& before, const ElasticField& from, ElasticField& to) {
    const ElasticLayout& layout = grid().layout();
    const auto& all = layout.cells;
    const std::array<int, 3> offset = cell_offset_to(before);
    for (int k = 0; k <= all[2]; ++k)
      for (int j = 0; j <= all[1]; ++j)
        for (int i = 0; i <= all[0]; ++i) {
          const int a = i + offset[0], b = j + offset[1], c = k + offset[2];
          if (a < 0 || b < 0 || c < 0 || a > all[0] || b > all[1] || c > all[2]) continue;
          for (int axis = 0; axis < 3; ++axis)
            to.values[layout.node(i, j, k, axis)] = from.values[layout.node(a, b, c, axis)];
        }
    solver.zero_constrained(to);
  }
  // updates cells and solver after material was removed or restored since the last frame
  void follow(const CarvedLabels& labels) {
    if (cells.follow(labels, solver).empty()) return;
    solver.zero_constrained(unit_mm);
    if (neo_hookean == nullptr) return;
    solver.zero_constrained(neo_hookean->correction_mm);
    solver.zero_constrained(neo_hookean->excess_response_mm);
  }

  /// Solves the neo-Hookean body at the tool's predicted depth, and adds F, C and grad C to the spot of the
  /// linear solution.
  /// @param is_first_solve  whether this is the first solve in the box, with more iterations
  void solve_neo_hookean(const PressurePatch& patch, double depth_mm, bool is_first_solve,
                         LocalCompliance& spot);
};

void SoftTissueSolver::Region::solve_neo_hookean(const PressurePatch& patch, double depth_mm,
                                                 bool is_first_solve, LocalCompliance& spot) {
  constexpr double kReductionAfterFailure = 0.7;  // factor of the attempted indentation ratio
  constexpr double kGrowthAfterSuccess = 1.1;     // factor of max_indentation_ratio
  constexpr double kMaxExtrapolation = 2;         // maximum ratio of the displacements of consecutive frames
  constexpr double kAtRestTolerance = 0.05;       // relative change of depth below which the tool is at rest
  NeoHookeanBody& body = *neo_hookean;
  const auto is_as_deep = [&](double mm) { return std::abs(depth_mm - mm) <= kAtRestTolerance * mm; };
  const bool at_rest = body.depth_mm > 0 && is_as_deep(body.depth_mm);
  body.depth_mm = std::max(depth_mm, 0.0);
  if (body.failed_depth_mm > 0 && !is_as_deep(body.failed_depth_mm)) body.failed_depth_mm = 0;
  const ConstrainedMeans surface = patch.columns(kSolverSettings.min_load_fraction);

  // displacement of the patch at the predicted depth, by the last published contact law
  const double w = spot.compliance_mm_per_N, rho_mm = spot.patch_radius_mm;
  ContactLaw tissue;
  tissue.surroundings_mm_per_N = spot.surroundings_mm_per_N;
  tissue.poissons_ratio = spot.poissons_ratio;
  tissue.modulus_N_per_mm2 = spot.modulus_N_per_mm2;
  tissue.stiffening_mm_per_N2 = body.stiffening_mm_per_N2;
  tissue.reference_force_N = body.reference_force_N;
  const double expected_N = soft_contact_force(tissue, depth_mm, radius_mm).force_N;
  const double expected_mm =
      w * expected_N - stiffening_depth_mm(body.stiffening_mm_per_N2, body.reference_force_N, expected_N);
  const double indentation_mm =
      std::clamp(expected_mm, kSolverSettings.min_indentation * rho_mm, body.max_indentation_ratio * rho_mm);
  const double s = indentation_mm / w;

  // initial guess: the previous correction, which grows with the square of the displacement
  const double growth =
      body.indentation_mm > 0 ? std::min(indentation_mm / body.indentation_mm, kMaxExtrapolation) : 0;
  const auto correction_scale = static_cast<float>(growth * growth), load_scale = static_cast<float>(s);
  for (float& value : body.excess_response_mm.values) value *= correction_scale;
  for (float& value : body.correction_mm.values) value *= correction_scale;
  surface.project_out(body.correction_mm.values);
  for (std::size_t n = 0; n < body.u_mm.values.size(); ++n)
    body.u_mm.values[n] = load_scale * unit_mm.values[n] + body.correction_mm.values[n];

  // load_N is the patch's load of 1 N, here scaled to s. Columns that bear less than min_load_fraction are
  // not constrained; the load acts at their nodes alone.
  for (float& value : load_N.values) value *= load_scale;
  NeoHookeanSettings settings;
  settings.max_steps = kSolverSettings.finite_steps;
  settings.max_iterations =
      is_first_solve ? kSolverSettings.first_iterations : kSolverSettings.finite_iterations;
  settings.min_volume = kSolverSettings.min_volume;
  const NeoHookeanSolution solution = solver.solve_neo_hookean(load_N, body.u_mm, settings, surface);
  solver.neo_hookean_forces(body.u_mm, body.force_N);
  const double force_N = internal::elastic::dot(unit_mm.values, body.force_N.values) / w;
  const double relative_stiffening = (force_N - s) / force_N;
  if (!(solution.min_volume >= kSolverSettings.min_volume) || solution.line_search_failed ||
      !(std::abs(relative_stiffening) <= kSoftTissueSettings.max_stiffening) || !(force_N > 0)) {
    const double reduced_ratio =
        std::max(kReductionAfterFailure * indentation_mm / rho_mm, kSolverSettings.min_indentation);
    if (at_rest && body.reference_force_N > 0) {
      // The previous result stays in effect, and no greater displacement is attempted until the tool moves:
      // otherwise the force on a resting tool would oscillate with every attempt.
      spot.reference_force_N = body.reference_force_N;
      spot.stiffening_mm_per_N2 = body.stiffening_mm_per_N2;
      body.indentation_mm = indentation_mm;
      body.failed_depth_mm = depth_mm;
    } else {
      // falls back to the linear law; the next attempt is shallower and starts from the linear solution
      body.reset();
    }
    body.max_indentation_ratio = reduced_ratio;
    return;
  }
  for (std::size_t n = 0; n < body.u_mm.values.size(); ++n)
    body.correction_mm.values[n] = body.u_mm.values[n] - load_scale * unit_mm.values[n];
  body.indentation_mm = indentation_mm;
  if (body.failed_depth_mm == 0)
    body.max_indentation_ratio =
        std::min(kGrowthAfterSuccess * body.max_indentation_ratio, kSolverSettings.max_indentation);

  // K (y - F u1) = f(u) - F J^T: the response to the forces that exceed those of the linear body under F
  patch.add(-force_N, body.force_N);
  solver.solve(body.force_N, body.excess_response_mm,
               is_first_solve ? kSolverSettings.first_iterations : kSolverSettings.tangential_iterations,
               kTolerance);
  spot.reference_force_N = body.reference_force_N = force_N;
  spot.stiffening_mm_per_N2 = body.stiffening_mm_per_N2 = w * relative_stiffening / force_N;
  spot.stiffening_gradient = (spot.gradient_per_N * (0.5 * force_N * (force_N - s)) +
                              patch.gradient_along_surface(body.excess_response_mm) * s) *
                             (3 / (force_N * force_N * force_N));
  if (!spot.stiffening_gradient.all_finite()) spot.stiffening_gradient = {};
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
        if (begin_spot(now)) {
          now.stage = Stage::kIterations;
          return false;
        }
        finish_spot(now);
        now.next_device();
        break;
      case Stage::kIterations:
        if (!region->solver.iterate(region->unit_mm)) return false;
        finish_spot(now);
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
  // computed first, because it reads the previous frame's spot
  now.force_N = displacing_force_N(now.device, device);
  frame_.spot[now.device] = {};
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
bool SoftTissueSolver::begin_spot(FrameInProgress& now) {
  const DeviceTick& device = now.tick.device[now.device];
  Region& region = *regions_[now.device];
  LocalCompliance& spot = frame_.spot[now.device];
  now.is_first_solve = std::exchange(region.needs_first_solve, false);

  const double cell_mm = region.grid().box().cell_mm;
  const double radius_mm =
      std::max(now.model.tool_of(now.device).radius_mm, kSoftTissueSettings.min_radius_mm);
  region.radius_mm = radius_mm;
  region.max_N_per_mm = max_deformable_stiffness_N_per_mm(now.model);
  const double min_mm = kSolverSettings.min_patch_cells * cell_mm;
  if (!(region.modulus > 0))
    region.modulus = PressurePatch(region.grid(), now.at, now.outward, min_mm).contact_modulus();
  now.depth_mm = expected_depth_mm(device, {now.at, now.outward}, radius_mm);
  const double contact_radius_mm =
      region.modulus > 0 ? radius_at_depth_mm(device, now.force_N, now.depth_mm, radius_mm, region.modulus)
                         : 0;
  now.rho_mm =
      std::clamp(contact_radius_mm, min_mm, kMaxPatchRadiusFraction * region.grid().box().cells[1] * cell_mm);
  now.patch = PressurePatch(region.grid(), now.at, now.outward, now.rho_mm);
  now.layer = supported_layer(now.labels, now.by_label, now.at, now.outward,
                              std::max(contact_radius_mm, 0.5 * cell_mm),
                              kSolverSettings.resolved_layer_cells * cell_mm);
  spot.at = now.at;
  spot.patch_radius_mm = now.rho_mm;
  if (now.layer) {
    const ElasticConstants constants{now.layer->material.youngs_modulus_kPa,
                                     now.layer->material.poissons_ratio};
    spot.modulus_N_per_mm2 = contact_modulus_N_per_mm2(constants);
    spot.poissons_ratio = constants.poissons_ratio;
  }
  region.modulus = now.patch.contact_modulus();
  if (!now.patch.touches()) return false;
  std::fill(region.load_N.values.begin(), region.load_N.values.end(), 0.0f);
  now.patch.add(1, region.load_N);
  region.solver.begin_solve(
      region.load_N, region.unit_mm,
      now.is_first_solve ? kSolverSettings.first_iterations : kSolverSettings.iterations, kTolerance);
  return true;
}

// Computes the device's spot from the linear solution, if there is one.
void SoftTissueSolver::finish_spot(FrameInProgress& now) {
  Region& region = *regions_[now.device];
  LocalCompliance& spot = frame_.spot[now.device];
  const double cell_mm = region.grid().box().cell_mm;
  if (now.patch.touches()) {
    spot.compliance_mm_per_N = now.patch.displacement(region.unit_mm);
    // W = J K^-1 J^T: the patch both applies the load and measures the displacement, hence the factor of 2
    spot.gradient_per_N = now.patch.gradient_along_surface(region.unit_mm) * 2;
    if (!now.layer) {
      spot.modulus_N_per_mm2 = region.modulus;
      spot.poissons_ratio = now.patch.poissons_ratio();
    }
  }
  if (spot.is_known()) {
    spot.compute_surroundings();
    add_deep_base_compliance(now.labels, now.by_label, region.grid().box(), {now.at, now.outward}, spot);
    if (now.layer) blend_with_thin_layer(*now.layer, cell_mm, spot);
  } else if (now.layer) {
    // the layer is thinner than a cell, so that all nodes of the cell are constrained
    blend_with_thin_layer(*now.layer, cell_mm, spot);
    spot.gradient_per_N = {};
    spot.compliance_mm_per_N = patch_compliance_mm_per_N(spot.surroundings_mm_per_N, now.rho_mm,
                                                         spot.modulus_N_per_mm2, spot.poissons_ratio);
    // the cells contribute nothing to the displacement
    if (const Tissue* const tissue = now.model.tissue_of(now.layer->label))
      spot.relaxed.add(tissue->relaxation, now.model.relaxation_times, 1);
    return;
  } else {
    spot = {};
    return;
  }
  if (region.neo_hookean != nullptr)
    region.solve_neo_hookean(now.patch, now.depth_mm, now.is_first_solve, spot);
  if (region.relaxation_weights) {
    const RelaxationWeights::Means means = region.relaxation_weights->under(region.grid(), region.unit_mm);
    spot.relaxed = means.relaxed;
    spot.strain_stiffening = means.stiffening;
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
  if (region == nullptr || !frame_.spot[device].is_known()) return false;
  field = {&region->grid().box(), &region->grid().layout(), &region->unit_mm};
  return true;
}

double SoftTissueSolver::displacing_force_N(std::size_t device, const DeviceTick& device_tick) const {
  const Region* region = device < regions_.size() ? regions_[device].get() : nullptr;
  if (region == nullptr || !region->relaxation_weights || !frame_.spot[device].is_known())
    return device_tick.contact_N[0];
  return instantaneous_force_N(device_tick, contact_law_of(frame_.spot[device]), region->radius_mm,
                               region->max_N_per_mm);
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
