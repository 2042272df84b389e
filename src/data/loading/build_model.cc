#include <algorithm>
#include <cmath>
#include <cstdio>

#include "loading/cached_preparation.h"
#include "loading/model_parts.h"
#include "palpate/base/reading.h"
#include "palpate/loading/loading.h"
#include "palpate/model/make_model.h"
#include "palpate/model/memory_forecast.h"
#include "palpate/model/ramp_structures.h"
#include "palpate/model/stiffness_layers.h"
#include "palpate/preparation/preparation.h"
#include "palpate/tissue/soft_tissue_solver.h"

namespace palpate {
namespace {

// maximum distance outside its structure at which the ramp of a threshold may begin
constexpr double kThresholdRamp_mm = 5;

// Infers the patient's side from anatomy: the fibula is lateral to the tibia.
Side side_from_anatomy(const Model& model) {
  const Segment* tibia = model.find("tibia");
  const Segment* fibula = model.find("fibula");
  if (!tibia || !fibula) return Side::kUnknown;
  const GridGeometry& grid = model.labels->geometry();
  Eigen::Vector3d sum[2] = {Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  double count[2] = {0, 0};
  model.labels->for_each_piece([&](const RowPiece<LabelId>& piece) {
    for (int n = 0; n < piece.count; ++n) {
      const LabelId label = piece.voxels[n];
      if (label != tibia->id && label != fibula->id) continue;
      const int which = label == fibula->id;
      sum[which] += Eigen::Vector3d(piece.i + n, piece.j, piece.k);
      count[which] += 1;
    }
  });
  if (count[0] == 0 || count[1] == 0) return Side::kUnknown;
  const auto X = grid.X_PatientVoxel();
  const double lateral_mm =
      (X * Point<Voxel>(sum[1] / count[1])).x() - (X * Point<Voxel>(sum[0] / count[0])).x();
  // minimum lateral offset for a conclusion
  constexpr double kClear_mm = 5;
  return lateral_mm > kClear_mm ? Side::kLeft : lateral_mm < -kClear_mm ? Side::kRight : Side::kUnknown;
}

// zero field, for scenes without touchable tissue, which can still be displayed
std::shared_ptr<const Field> empty_field(const PreparationSettings& preparation, const GridGeometry& grid) {
  if (preparation.storage == FieldStorage::k8Bit)
    return std::make_shared<const Field>(Volume<std::uint8_t>(grid));
  return std::make_shared<const Field>(Volume<std::uint16_t>(grid));
}

// Gaussian smoothing creates the ramp along which the force increases
Result<std::shared_ptr<const Field>> smoothed_field(const PreparationSettings& preparation,
                                                    const Volume<std::uint8_t>& weights,
                                                    const Progress& progress) {
  if (std::all_of(weights.voxels().begin(), weights.voxels().end(), [](std::uint8_t w) { return w == 0; }))
    return empty_field(preparation, weights.geometry());
  GaussianOptions options;
  options.sigma_mm = preparation.sigma_mm;
  options.engine = preparation.engine;
  const auto keep = [](auto smoothed) -> Result<std::shared_ptr<const Field>> {
    if (!smoothed) return smoothed.error();
    return std::make_shared<const Field>(*smoothed);
  };
  return preparation.storage == FieldStorage::k8Bit ? keep(cached_smooth(weights, options, progress))
                                                    : keep(cached_smooth_16(weights, options, progress));
}

// warns of structures too thin to reach the force limit, weakest first
void warn_of_thin_structures(const RampFieldResult& made, const Warn& warn) {
  if (!warn) return;
  const Model& model = *made.model;
  // force that counts as sufficient if the scene has no limit
  constexpr double kHeld_N = 0.5;
  constexpr std::size_t kNamed = 4;
  const double target_N = std::min(
      {std::isfinite(model.scene_max_force_N) ? model.scene_max_force_N : kHeld_N, made.full_force_N});
  std::vector<RampStatistics> thin;
  for (const RampStatistics& figures : made.ramps) {
    // a soft tissue does not reach it at any depth
    const double soft_N = model.tissue_of(figures.label)->stiffness_N_per_mm * kDeepestRamp_mm;
    if (figures.max_N < std::min(target_N, 0.99 * soft_N)) thin.push_back(figures);
  }
  if (thin.empty()) return;
  std::stable_sort(thin.begin(), thin.end(),
                   [](const RampStatistics& a, const RampStatistics& b) { return a.max_N < b.max_N; });
  const auto newtons = [](double force_N) {
    char text[32];
    std::snprintf(text, sizeof text, "%.2g N", force_N);
    return std::string(text);
  };
  std::string text;
  for (std::size_t n = 0; n < std::min(thin.size(), kNamed); ++n)
    text += (n == 0 ? "thin: " : ", ") + model.name_of(thin[n].label) + (n == 0 ? " gives at most " : " ") +
            newtons(thin[n].max_N);
  if (thin.size() > kNamed) text += " and " + std::to_string(thin.size() - kNamed) + " more,";
  warn(text + " of " + newtons(target_N) + " (direct methods)");
}

// one sentence for each contact layer that merges tissues of different stiffness
std::vector<Caveat> merged_layers(const Model& model) {
  std::vector<double> stiffnesses;
  for (const Tissue& tissue : model.tissues)
    if (tissue.touchable && !model.is_deformable(tissue)) stiffnesses.push_back(tissue.stiffness_N_per_mm);
  std::vector<Caveat> caveats;
  for (const StiffnessRange& layer : stiffness_layers(std::move(stiffnesses))) {
    if (layer.max_N_per_mm <= kSameStiffness * layer.min_N_per_mm) continue;
    char text[160];
    std::snprintf(text, sizeof text,
                  "tissues of %.3g to %.3g N/mm share one layer where they touch, up to %.0f %% too soft: "
                  "contact has at most %d layers of stiffness",
                  layer.min_N_per_mm, layer.max_N_per_mm, 100 * layer.error(), kMaxLayers);
    caveats.push_back({CaveatKind::kForce, text});
  }
  return caveats;
}

// Memory forecast of the remaining steps. If the model is unsuitable for the proxy, that error is reported by
// its preparation, not here.
Result<MemoryForecast> forecast_of(const Scene& scene, const ReadyParts& ready,
                                   const ModelPreparation& preparation, const Progress& progress) {
  const bool ramps = scene.preparation.method == PreparationMethod::kInwardRamp;
  ForecastOptions options;
  options.proxy = scene.force.method == ForceMethod::kProxy;
  options.field = !options.proxy || !ramps;
  auto forecast = forecast_memory(ready.parts, options, preparation, progress);
  if (!forecast && forecast.error().kind == ErrorKind::kBadInput) {
    options.proxy = false;
    forecast = forecast_memory(ready.parts, options, preparation, progress);
  }
  if (!forecast || ramps) return forecast;
  // smoothing: weights, two float volumes, the field
  constexpr std::uint64_t kSmoothedBytesPerVoxel = 12;
  forecast->peak_of_field = kSmoothedBytesPerVoxel * ready.parts.labels->geometry().voxel_count();
  forecast->peak = std::max(forecast->peak, forecast->peak_of_field);
  return forecast;
}

std::uint64_t bytes_of(const SceneVolumes& volumes) {
  std::uint64_t bytes = 0;
  if (volumes.labels)
    bytes += volumes.labels->layers.size() * volumes.labels->geometry().voxel_count() * sizeof(LabelId);
  if (volumes.scan) bytes += volumes.scan->geometry().voxel_count() * sizeof(float);
  return bytes;
}

Result<SceneMemory> memory_of_parts(const Scene& scene, const ReadyParts& ready, std::uint64_t read,
                                    const ModelPreparation& preparation, const Progress& progress) {
  const auto forecast = forecast_of(scene, ready, preparation, progress);
  if (!forecast) return forecast.error();
  SceneMemory memory{read, 0, *forecast};
  if (ready.scan) memory.scan = ready.scan->geometry().voxel_count() * sizeof(float);
  const ModelParts& parts = ready.parts;
  if (is_elastic(parts.tissue_law))
    memory.tissue_cell_mm =
        parts.tissue_cell_mm > 0
            ? parts.tissue_cell_mm
            : default_solver_cell_mm(parts.tissue_law, parts.labels->geometry().min_spacing_mm(),
                                     parts.tools);
  return memory;
}

}  // namespace

Result<std::shared_ptr<const Model>> build_model(const Scene& scene, const LabelMap* labels,
                                                 const Volume<float>* scan, const Progress& progress,
                                                 const Warn& warn, bool oriented) {
  SceneVolumes volumes{{}, {}, oriented};
  if (labels) volumes.labels = *labels;
  if (scan) volumes.scan = std::make_shared<const Volume<float>>(*scan);
  return build_model(scene, std::move(volumes), progress, warn);
}

Result<SceneMemory> memory_of(const Scene& scene, SceneVolumes volumes, const Progress& progress) {
  const std::uint64_t read = bytes_of(volumes);
  auto ready = ready_parts(scene, volumes, progress, {});
  if (!ready) return ready.error();
  return memory_of_parts(scene, *ready, read, CachedPreparation(), progress);
}

Result<std::shared_ptr<const Model>> build_model(const Scene& scene, SceneVolumes volumes,
                                                 const Progress& progress, const Warn& warn,
                                                 const MemoryCallback& report_memory) {
  const auto of_scene = [&](Error error) {
    if (error.where.empty()) error.where = scene.source;
    return error;
  };
  const std::uint64_t read = bytes_of(volumes);
  auto ready_made = ready_parts(scene, volumes, progress, warn);
  if (!ready_made) return of_scene(ready_made.error());
  ModelParts& parts = ready_made->parts;
  const GridGeometry grid = parts.labels->geometry();
  const CachedPreparation preparation;
  const auto memory = memory_of_parts(scene, *ready_made, read, preparation, progress);
  if (!memory) return of_scene(memory.error());
  if (report_memory) report_memory(*memory);
  if (auto allowed = check_memory(memory->model.peak, scene.source); !allowed) return allowed.error();
  if (scene.preparation.method != PreparationMethod::kInwardRamp) {
    auto field = smoothed_field(scene.preparation, ready_made->weights, progress);
    if (!field) return of_scene(field.error());
    parts.smoothed = *std::move(field);
    ready_made->weights = {};
    // the kernel is truncated at 4 sigma; the ramp of a threshold begins outside the structure
    const bool by_threshold = std::any_of(scene.tissues.begin(), scene.tissues.end(),
                                          [](const TissueSettings& t) { return t.threshold.has_value(); });
    parts.smoothed_reach_mm =
        grid.spacing_mm.maxCoeff() + 4 * parts.sigma_mm + (by_threshold ? kThresholdRamp_mm : 0);
  }
  parts.scan = ready_made->scan;
  auto made = make_model(std::move(parts));
  if (!made) return of_scene(made.error());
  std::shared_ptr<Model> model = *std::move(made);
  const bool is_direct = scene.force.method != ForceMethod::kProxy;
  if (is_direct && model->field == nullptr) {
    auto ramps = with_ramp_field(*model, preparation, progress);
    if (!ramps) return of_scene(ramps.error());
    warn_of_thin_structures(*ramps, warn);
    model = std::make_shared<Model>(*ramps->model);
  }
  model->caveats = merged_layers(*model);
  model->enclosing = std::move(ready_made->enclosing);

  model->oriented = volumes.oriented;
  const Side anatomy = volumes.oriented ? side_from_anatomy(*model) : Side::kUnknown;
  model->side_from_anatomy = scene.side == Side::kUnknown && anatomy != Side::kUnknown;
  model->side = model->side_from_anatomy ? anatomy : scene.side;
  if ((scene.side == Side::kLeft || scene.side == Side::kRight) && anatomy != Side::kUnknown &&
      anatomy != scene.side)
    model->caveats.push_back(
        {CaveatKind::kSide, "the side in the scene contradicts the anatomy: by the fibula this is a " +
                                std::string(anatomy == Side::kLeft ? "left" : "right") + " leg"});
  if (warn)
    for (const Caveat& caveat : model->caveats) warn(caveat.text);
  // these have been reported while reading the files
  model->caveats.insert(model->caveats.begin(), volumes.caveats.begin(), volumes.caveats.end());
  if (warn && !volumes.oriented)
    warn(
        "the files do not state the orientation of the volume in the patient: sides and directions are "
        "unknown");
  // surfaces take seconds and memory, and are only made for the proxy
  if (!is_direct) return std::shared_ptr<const Model>(model);
  auto ready = prepared_for(model, {&scene.force.method, 1}, preparation, progress);
  if (!ready) return of_scene(ready.error());
  return ready;
}

Result<std::shared_ptr<const Model>> prepared_with_cache(std::shared_ptr<const Model> model,
                                                         std::span<const ForceMethod> methods,
                                                         const Progress& progress) {
  // the forecast of a scene rendered by the proxy does not count the field
  const bool is_direct = std::any_of(methods.begin(), methods.end(),
                                     [](ForceMethod method) { return method != ForceMethod::kProxy; });
  if (is_direct && model != nullptr && model->labels != nullptr && model->field == nullptr)
    if (auto allowed = check_memory(memory_of_ramp_field(*model).peak, "field of the direct methods");
        !allowed)
      return allowed.error();
  return prepared_for(std::move(model), methods, CachedPreparation(), progress);
}

std::unique_ptr<const ModelPreparation> cached_preparation() {
  return std::make_unique<CachedPreparation>();
}

bool has_touchable_tissue(const Model& model) {
  const std::vector<std::size_t> voxels = label_counts(*model.labels);
  for (std::size_t label = 0; label < voxels.size(); ++label)
    if (voxels[label] > 0 && model.is_touchable(static_cast<LabelId>(label))) return true;
  return false;
}

}  // namespace palpate
