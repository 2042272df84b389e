#include "verification/tissue_removal.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "palpate/contact/soft_contact.h"
#include "palpate/tissue/carved_cells.h"
#include "palpate/tissue/carving.h"
#include "palpate/tissue/elastic_contact.h"
#include "palpate/tissue/soft_tissue_solver.h"
#include "verification/tissue_frame.h"

namespace palpate {
namespace {

constexpr double kPresser_mm = 3, kPressed_mm = 2, kHead_mm = 2;
constexpr int kTruthIterations = 200;
constexpr double kTruthTolerance = 1e-6;

double pressing_N(const LocalCompliance& local) {
  return soft_contact_force(contact_law_of(local), kPressed_mm, kPresser_mm).force_N;
}

double pressing_N(double compliance, double rho_mm, const PressurePatch& patch) {
  LocalCompliance local;
  local.compliance_mm_per_N = compliance;
  local.modulus_N_per_mm2 = patch.contact_modulus_N_per_mm2();
  local.poissons_ratio = patch.poissons_ratio();
  local.patch_radius_mm = rho_mm;
  local.compute_surroundings();
  return pressing_N(local);
}

double median_ms(std::vector<double> seconds) {
  std::nth_element(seconds.begin(), seconds.begin() + seconds.size() / 2, seconds.end());
  return 1e3 * seconds[seconds.size() / 2];
}

// height of the surface in a frame, under the tool, and the region swept until then
struct CutFrame {
  double surface_mm = 0;
  std::vector<Cut> cuts;
};

CutTissue cut_frame_by_frame(const Model& model, int frames, const std::function<CutFrame(int)>& cut) {
  const std::vector<ElasticMaterial> by_label = materials_of(model);
  ElasticBox box = elastic_box_of(model.labels->geometry(), {{0, 0, 0}, {1, 1, 1}}, solver_cell_mm(model));
  box.cells = {kSolverSettings.cells_along, kSolverSettings.cells_across, kSolverSettings.cells_across};
  const Point<Patient> pressed(0, 0, 0);
  const Point<Patient> centre = pressed - Vector<Patient>(0, 0, kSolverSettings.depth_cells * box.cell_mm);
  Eigen::Vector3d first = box.local_mm(centre) / box.cell_mm;
  for (int axis = 0; axis < 3; ++axis) first[axis] = std::floor(first[axis] - 0.5 * box.cells[axis]);
  box.corner = box.patient(first * box.cell_mm);

  const double rho_mm =
      std::max(kSolverSettings.min_patch_cells * box.cell_mm, std::sqrt(kPresser_mm * kPressed_mm));
  auto carving = std::make_shared<const Carving>(model);
  CarvedCells cells({model.labels, nullptr}, by_label, box, pressed);
  ElasticSolver solver(cells.grid());
  const ElasticLayout& layout = cells.grid().layout();
  ElasticField unit(layout), converged(layout), load(layout);
  std::vector<double> update_s, frame_s;
  double first_N = 0, last_N = 0;
  CutTissue result;
  const auto deviation_percent = [](double one, double other) { return 100 * std::abs(one / other - 1); };
  for (int frame = 0; frame < frames; ++frame) {
    const CutFrame now = cut(frame);
    if (!now.cuts.empty()) carving = carving->with(now.cuts);
    const CarvedLabels labels{model.labels, carving->removed_fraction()};
    const double begin = tissue_thread_seconds();
    if (!cells.follow(labels, solver).empty()) solver.zero_constrained(unit);
    const double followed = tissue_thread_seconds();
    const PressurePatch patch(cells.grid(), Point<Patient>(0, 0, now.surface_mm), {0, 0, 1}, rho_mm);
    std::fill(load.values.begin(), load.values.end(), 0.0f);
    patch.add(1, load);
    solver.solve(load, unit, frame == 0 ? kTruthIterations : kSolverSettings.iterations, kTruthTolerance);
    if (frame > 0) {
      update_s.push_back(followed - begin);
      frame_s.push_back(tissue_thread_seconds() - begin);
    }
    const double w = patch.displacement_mm(unit);
    const double force_N = pressing_N(w, rho_mm, patch);

    converged = unit;
    solver.solve(load, converged, kTruthIterations, kTruthTolerance);
    result.lag_percent = std::max(result.lag_percent, deviation_percent(w, patch.displacement_mm(converged)));
    // every few frames it is compared with cells that are cut all at once
    constexpr int kWhole = 8;
    if (frame % kWhole == kWhole - 1) {
      const CarvedCells whole(labels, by_label, box, pressed);
      ElasticSolver fresh(whole.grid());
      const PressurePatch there(whole.grid(), Point<Patient>(0, 0, now.surface_mm), {0, 0, 1}, rho_mm);
      std::fill(load.values.begin(), load.values.end(), 0.0f);
      there.add(1, load);
      fresh.zero_constrained(converged);
      fresh.solve(load, converged, kTruthIterations, kTruthTolerance);
      result.behind_percent =
          std::max(result.behind_percent, deviation_percent(w, there.displacement_mm(converged)));
    }
    if (frame > 0)
      result.change_percent = std::max(result.change_percent, deviation_percent(force_N, last_N));
    if (frame == 0) first_N = force_N;
    last_N = force_N;
    ++result.frames;
  }
  result.force_changed_percent = 100 * (last_N / first_N - 1);
  result.update_ms = median_ms(update_s);
  result.frame_ms = median_ms(frame_s);
  return result;
}

}  // namespace

CutTissue mill_nearby(const Model& model, double speed_mm_s) {
  constexpr double kFar_mm = 10, kDeep_mm = 3, kEdge_mm = 2.5;
  const double step_mm = speed_mm_s * kSolverFrame_s;
  const Point<Patient> from(kEdge_mm + kHead_mm, -kFar_mm, kHead_mm - kDeep_mm);
  return cut_frame_by_frame(model, 1 + static_cast<int>(2 * kFar_mm / step_mm), [&](int frame) {
    CutFrame now;
    if (frame == 0) return now;
    const Vector<Patient> step(0, step_mm, 0);
    now.cuts = {{0, {from + step * (frame - 1), from + step * frame, kHead_mm}}};
    return now;
  });
}

CutTissue trim_under(const Model& model, double speed_mm_s) {
  constexpr double kHalf_mm = 4, kDeep_mm = 4;
  const double step_mm = speed_mm_s * kSolverFrame_s;
  return cut_frame_by_frame(model, 1 + static_cast<int>(kDeep_mm / step_mm), [&](int frame) {
    CutFrame now;
    if (frame == 0) return now;
    // a horizontal cylinder, moved perpendicular to its axis
    now.surface_mm = -step_mm * frame;
    const double z = now.surface_mm + kHead_mm;
    now.cuts = {
        {0,
         {{-kHalf_mm, -kHalf_mm, z}, {kHalf_mm, -kHalf_mm, z}, kHead_mm, 0, {0, 2 * kHalf_mm, 0}, kHead_mm}}};
    return now;
  });
}

Recentring slide_through_boxes(const Model& model, double speed_mm_s) {
  constexpr double kFar_mm = 16;
  SoftTissueSolver solver;
  Recentring result;
  double last_N = 0;
  Point<Patient> corner;
  const double step_mm = speed_mm_s * kSolverFrame_s;
  for (double x = -kFar_mm; x < kFar_mm; x += step_mm) {
    TickRecord tick;
    DeviceTick& device = tick.device[0];
    device.tip_patient_mm = {x, 0.3, kPresser_mm - kPressed_mm};
    device.velocity_patient_mm_s = {speed_mm_s, 0, 0};
    device.contact_label[0] = device.label = 1;
    device.contact_patient_mm = {x, 0.3, 0};
    device.normal_patient = {0, 0, 1};
    device.depth_mm = kPressed_mm;
    device.contact_N[0] = last_N;
    const LocalCompliance& local = solver.solve(model, tick).local_compliance[0];
    UnitDisplacementField field;
    if (!local.is_known() || !solver.field_of(0, field)) continue;
    const double force_N = pressing_N(local);
    const bool anew = last_N > 0 && !(field.box->corner == corner);
    if (anew) {
      result.change_percent = std::max(result.change_percent, 100 * std::abs(force_N / last_N - 1));
      ++result.boxes;
    }
    corner = field.box->corner;
    last_N = force_N;
  }
  return result;
}

}  // namespace palpate
