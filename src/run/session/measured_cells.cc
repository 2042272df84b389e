#include "session/measured_cells.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <iterator>
#include <optional>
#include <vector>

#include "palpate/base/reading.h"
#include "palpate/loading/loading.h"
#include "palpate/model/changed_model.h"
#include "palpate/recording/recording.h"
#include "palpate/tissue/displayed_law.h"

namespace palpate {
namespace {

constexpr double kCoarser[] = {1.25, 1.6, kMaxTissueCellFactor};

double processor_time_s() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

// Points at which soft tissue borders empty space, on some lines through the volume.
std::vector<Point<Patient>> soft_borders(const Model& model) {
  constexpr int kLines = 24;
  const Bricks<LabelId>& labels = *model.labels;
  const GridGeometry& grid = labels.geometry();
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  const auto is_empty = [&](LabelId label) {
    const Tissue* tissue = model.tissue_of(label);
    return tissue == nullptr || !tissue->touchable;
  };
  const auto can_deform = [&](LabelId label) {
    return !is_empty(label) && model.is_deformable(*model.tissue_of(label));
  };
  std::vector<Point<Patient>> positions;
  const int j_step = std::max(1, grid.dims[1] / kLines), k_step = std::max(1, grid.dims[2] / kLines);
  for (int k = k_step / 2; k < grid.dims[2]; k += k_step)
    for (int j = j_step / 2; j < grid.dims[1]; j += j_step)
      for (int i = 1; i < grid.dims[0]; ++i) {
        const LabelId one = labels.at(i - 1, j, k), other = labels.at(i, j, k);
        if ((is_empty(one) && can_deform(other)) || (is_empty(other) && can_deform(one)))
          positions.push_back(X_PatientVoxel * Point<Voxel>(i - 0.5, j, k));
      }
  return positions;
}

// Median processor time of a few frames in which every device presses at `at`; empty if no tissue is solved
// there.
std::optional<double> frame_s(const Model& model, const Point<Patient>& at, std::size_t devices) {
  constexpr int kFrames = 7;
  TickRecord tick;
  tick.devices = static_cast<int>(devices);
  for (std::size_t d = 0; d < devices; ++d)
    for (int axis = 0; axis < 3; ++axis)
      tick.device[d].tip_patient_mm[static_cast<std::size_t>(axis)] = at[axis];
  SoftTissueSolver solver;
  if (!solver.solve(model, tick).local_compliance[0].is_known()) return std::nullopt;
  std::array<double, kFrames> times_s;
  for (double& time_s : times_s) {
    const double started_s = processor_time_s();
    solver.solve(model, tick);
    time_s = processor_time_s() - started_s;
  }
  std::nth_element(times_s.begin(), times_s.begin() + kFrames / 2, times_s.end());
  return times_s[kFrames / 2];
}

}  // namespace

MeasuredCells with_measured_cells(std::shared_ptr<const Model> model, std::size_t devices,
                                  double max_frame_s) {
  if (!is_elastic(model->tissue_law) || !model->has(ForceMethod::kProxy) || model->tissue_cell_factor > 1)
    return {std::move(model), {}};
  // one of several spread-out points suffices
  constexpr std::size_t kTries = 5;
  const std::vector<Point<Patient>> positions = soft_borders(*model);
  std::optional<double> made_s;
  Point<Patient> position;
  for (std::size_t n = 0; n < std::min(kTries, positions.size()) && !made_s; ++n) {
    position = positions[(2 * n + 1) * positions.size() / (2 * kTries)];
    made_s = frame_s(*model, position, devices);
  }
  if (!made_s || *made_s <= max_frame_s) return {std::move(model), {}};

  auto coarser = std::make_shared<Model>(*model);
  for (const double factor : kCoarser) {
    coarser->tissue_cell_factor = factor;
    const auto time_s = frame_s(*coarser, position, devices);
    if (time_s && *time_s <= max_frame_s) break;
  }
  char warning[256];
  std::snprintf(warning, sizeof warning,
                "soft tissue is solved in cells of %.3g mm instead of %.3g: with these a solution takes %.3g "
                "ms on this machine, but one is due every %.3g",
                solver_cell_mm(*coarser), solver_cell_mm(*model), 1e3 * *made_s, 1e3 * kSolverFrame_s);
  return {std::move(coarser), warning};
}

Result<MeasuredCells> measured_under_law(const Model& model, TissueLaw law, std::size_t devices,
                                         const Progress& progress) {
  const auto preparation = cached_preparation();
  if (has_other_surfaces(model, law)) {
    // the current surfaces stay in memory meanwhile
    const auto bytes = memory_of_surfaces(displayed_under_law(model, law), *preparation, progress);
    if (!bytes) return bytes.error();
    if (auto allowed = check_memory(*bytes, "surfaces of soft tissue"); !allowed) return allowed.error();
  }
  auto under = under_law(model, law, *preparation, progress);
  if (!under) return under.error();
  if (!is_elastic(law)) return MeasuredCells{*std::move(under), {}};
  auto whole = std::make_shared<Model>(**under);
  whole->tissue_cell_factor = 1;
  return with_measured_cells(std::move(whole), devices);
}

}  // namespace palpate
