#include <algorithm>
#include <chrono>
#include <cstdio>

#include "palpate/base/file.h"
#include "palpate/cohort/case.h"
#include "palpate/cohort/cohort_table.h"
#include "palpate/cohort/thickness.h"
#include "palpate/loading/loading.h"
#include "palpate/palpation/palpation.h"
#include "palpate/rendering/volume_picture.h"
#include "palpate/rendering/volume_renderer.h"
#include "palpate/surfaces/surfaces.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

/// Larger volumes get no picture: a solid voxel takes 32 bytes during rendering.
constexpr std::size_t kMaxVoxelsDrawn = std::size_t{1} << 28;
constexpr int kPicture_px = 320;
constexpr double kHeld_s = 0.1;

class Clock {
 public:
  /// Time since the last call, s.
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    const std::chrono::duration<double> passed = now - since_;
    since_ = now;
    return passed.count();
  }

 private:
  std::chrono::steady_clock::time_point since_ = std::chrono::steady_clock::now();
};

/// Computes volumes, components, minimum thickness and gaps of the model's structures.
Result<void> check_structures(const Model& model, CaseResult& result, const Progress& progress) {
  LabelMap map;
  map.layers.push_back(model.labels->dense());
  map.segments = model.segments;
  // flattened: each voxel has the id of its segment
  for (Segment& segment : map.segments) {
    segment.layer = 0;
    segment.value = segment.id;
  }
  const auto statistics = segment_statistics(map);
  std::vector<LabelId> touchable;
  for (const SegmentStatistics& s : statistics)
    if (const Tissue* tissue = model.tissue_of(s.id); tissue != nullptr && tissue->touchable)
      touchable.push_back(s.id);
  const auto leaks = find_leaks(*model.labels, touchable, 0, progress);
  if (!leaks) return leaks.error();
  for (const SegmentStatistics& s : statistics) {
    if (progress.stopped()) return Progress::interrupted();
    StructureResult structure;
    structure.name = model.name_of(s.id);
    structure.volume_mm3 = s.volume_mm3;
    structure.components = s.components;
    if (const auto thin = minimum_thickness(map.layers.front(), s))
      structure.thinnest_mm = thin->thickness_mm;
    for (const Leaks& leak : *leaks)
      if (leak.label == s.id) structure.gaps = leak.joints;
    structure.touchable = std::ranges::find(touchable, s.id) != touchable.end();
    result.structures.push_back(std::move(structure));
  }
  return {};
}

/// Assigns the palpation results to the structures.
void put_palpation(const SimulationResult& run, CaseResult& result) {
  for (const HoldFigure& hold : run.holds) {
    ++result.palpated;
    result.held += hold.held_s >= kHeld_s;
    const auto structure = std::ranges::find(result.structures, hold.structure, &StructureResult::name);
    if (structure == result.structures.end()) continue;
    structure->held_s = hold.held_s;
    structure->mean_force_N = hold.mean_force_N;
    structure->peak_force_N = hold.peak_force_N;
  }
  result.failed_steps = static_cast<int>(run.failed_steps);
  result.largest_force_N = run.max_force_N;
  result.ticks = run.summary.ticks;
  result.run_hash = run.summary.run_hash;
}

std::string times_json(const CaseTimes& times) {
  char text[200];
  std::snprintf(text, sizeof text,
                "{\"read_s\": %.3f, \"check_s\": %.3f, \"palpate_s\": %.3f, \"picture_s\": %.3f}\n",
                times.read_s, times.check_s, times.palpate_s, times.picture_s);
  return text;
}

Result<void> make_folder(const fs::path& folder) {
  std::error_code failed;
  fs::create_directories(folder, failed);
  if (failed)
    return Error{ErrorKind::kOutput, "the folder cannot be created: " + failed.message(), folder.string(),
                 "is the disk full, or does the folder belong to another account?"};
  return {};
}

}  // namespace

Result<void> write_fault(const CohortCase& cohort_case, int number, const fs::path& cohort,
                         const std::string& key, const std::string& fault) {
  CaseResult result;
  result.key = key;
  result.fault = without_names(fault, cohort_case, cohort);
  const fs::path folder = case_folder(cohort, number);
  if (auto made = make_folder(folder); !made) return made;
  std::error_code none;
  fs::remove(folder / "picture.png", none);
  return write_file(folder / "result.json", case_json(result));
}

Result<CaseResult> run_case(const CohortCase& cohort_case, int number, const fs::path& cohort,
                            const CaseOptions& options, const Progress& progress) {
  const fs::path folder = case_folder(cohort, number);
  if (auto made = make_folder(folder); !made) return made.error();
  std::error_code none;
  // remove the output of an earlier run
  for (const char* name : {"result.json", "times.json", "picture.png", "run.h5"})
    fs::remove(folder / name, none);

  CaseResult result;
  CaseTimes times;
  const auto key = case_key(cohort_case, options.program, progress);
  // without a key the case is retried in every run
  if (key)
    result.key = *key;
  else if (key.error().kind == ErrorKind::kInterrupted)
    return key.error();
  const Warn warn = [&](const std::string& text) {
    result.notes.push_back(without_names(text, cohort_case, cohort));
  };
  // without the file's name: the row identifies the case
  const auto failed = [&](const Error& error) -> Result<void> {
    if (error.kind == ErrorKind::kInterrupted || error.kind == ErrorKind::kOutput) return error;
    result.fault = without_names(error.what, cohort_case, cohort);
    return {};
  };

  const auto work = [&]() -> Result<void> {
    Clock clock;
    const auto loaded = load_scene_or_data_set(
        {cohort_case.target, cohort_case.segmentation, cohort_case.names, cohort_case.volume}, progress,
        warn);
    times.read_s = clock.lap();
    if (!loaded) return failed(loaded.error());
    const Model& model = *loaded->model;
    if (model.labels == nullptr) {
      result.fault = "has no structures: it is only a scan";
      return {};
    }
    result.dims = model.labels->geometry().dims;
    result.spacing_mm = model.labels->geometry().spacing_mm;
    if (auto checked = check_structures(model, result, progress); !checked) return checked;
    times.check_s = clock.lap();

    if (model.labels->geometry().voxel_count() <= kMaxVoxelsDrawn) {
      const auto png = volume_thumbnail(model, kPicture_px, progress);
      if (!png) return png.error();
      if (auto written =
              write_file(folder / "picture.png", {reinterpret_cast<const char*>(png->data()), png->size()});
          !written)
        return written;
    }
    times.picture_s = clock.lap();

    if (auto touchable = require_touchable_tissue(*loaded); !touchable) return failed(touchable.error());
    std::optional<Script> script;
    if (cohort_case.script) {
      auto read = load_script(*cohort_case.script);
      if (!read) return failed(read.error());
      script = *std::move(read);
    }
    SimulationOptions simulation;
    simulation.max_force_N = cohort_case.max_force_N;
    simulation.seed = cohort_case.seed;
    simulation.rate_hz = cohort_case.rate_hz;
    simulation.method = cohort_case.method;
    const auto run =
        simulate(*loaded, script, simulation, options.recording ? folder / "run.h5" : fs::path(), progress);
    times.palpate_s = clock.lap();
    if (!run) return failed(run.error());
    put_palpation(*run, result);
    for (const std::string& problems : run->problems) warn(problems);
    return {};
  };
  if (auto done = work(); !done) return done.error();
  if (auto written = write_file(folder / "times.json", times_json(times)); !written) return written.error();
  if (auto written = write_file(folder / "result.json", case_json(result)); !written) return written.error();
  return result;
}

}  // namespace palpate
