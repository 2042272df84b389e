#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>

#include "loading/body.h"
#include "loading/cached_preparation.h"
#include "palpate/base/reading.h"
#include "palpate/contact/colours.h"
#include "palpate/loading/loading.h"
#include "palpate/model/make_model.h"
#include "palpate/model/memory_forecast.h"
#include "palpate/model/ramp_structures.h"
#include "palpate/model/stiffness_layers.h"
#include "palpate/preparation/preparation.h"
#include "palpate/tissue/soft_tissue_solver.h"
#include "palpate/volume/overlaps.h"

namespace palpate {
namespace {

// label ids of structures defined by threshold or embedding: above those used by typical segmentations
constexpr LabelId kFirstThresholdLabel = 60000;

// maximum distance outside its structure at which the ramp of a threshold may begin
constexpr double kThresholdRamp_mm = 5;

bool reaches_beyond(const GridGeometry& inner, const GridGeometry& outer) {
  const auto X_OuterInner = outer.X_PatientVoxel().inverse() * inner.X_PatientVoxel();
  for (int corner = 0; corner < 8; ++corner) {
    Point<Voxel> p;
    for (int axis = 0; axis < 3; ++axis) p[axis] = corner >> axis & 1 ? inner.dims[axis] - 1 : 0;
    const Point<Voxel> q = X_OuterInner * p;
    for (int axis = 0; axis < 3; ++axis)
      if (q[axis] < -0.5 || q[axis] > outer.dims[axis] - 0.5) return true;
  }
  return false;
}

// resamples scan or labels onto the finer of their grids, with a warning that says which
Result<void> resample_to_common_grid(SceneVolumes& volumes, const Progress& progress, const Warn& warn) {
  if (!volumes.labels || !volumes.scan || volumes.labels->geometry().same_grid(volumes.scan->geometry()))
    return {};
  const LabelMap& labels = *volumes.labels;
  const Volume<float>& scan = *volumes.scan;
  if (&field_grid(&labels.geometry(), &scan.geometry()) == &labels.geometry()) {
    // voxels outside the scan get its minimum value: 0 HU would be tissue
    const float darkest = *std::min_element(scan.voxels().begin(), scan.voxels().end());
    auto moved = cached_resampled(scan, labels.geometry(), darkest, progress);
    if (!moved) return moved.error();
    if (warn) {
      warn(
          "scan and labels lie on different grids: the scan was resampled onto the labels' grid, which is "
          "finer");
      if (reaches_beyond(labels.geometry(), scan.geometry()))
        warn("the label map extends beyond the scan; the darkest value of the scan is used there");
    }
    volumes.scan = std::make_shared<const Volume<float>>(*std::move(moved));
    return {};
  }
  auto moved = cached_resampled(labels, scan.geometry(), progress);
  if (!moved) return moved.error();
  if (warn) {
    warn(
        "scan and labels lie on different grids: the labels were resampled onto the scan's grid, which is "
        "finer, by nearest neighbour");
    if (reaches_beyond(labels.geometry(), scan.geometry()))
      warn("part of the label map lies outside the scan and is not touchable");
  }
  volumes.labels = *std::move(moved);
  return {};
}

Tissue tissue_of(const TissueSettings& settings, const std::vector<TissueSettings>& all) {
  Tissue tissue;
  static_cast<TissueProperties&>(tissue) = settings;
  tissue.name = settings.name;
  if (settings.colour) tissue.colour = *settings.colour;
  for (const std::string& support : settings.rests_on)
    for (std::size_t t = 0; t < all.size(); ++t)
      if (all[t].name == support) tissue.rests_on.push_back(static_cast<int>(t));
  return tissue;
}

// index of the label's tissue; -1: none
int tissue_index(const ModelParts& parts, LabelId label) {
  return label < parts.tissue_of_label.size() ? parts.tissue_of_label[label] : -1;
}

void set_label(ModelParts& parts, LabelId label, std::size_t tissue) {
  if (label >= parts.tissue_of_label.size()) parts.tissue_of_label.resize(label + 1, -1);
  parts.tissue_of_label[label] = static_cast<std::int16_t>(tissue);
}

// below every weight of a touchable tissue, above those of other tissues
constexpr std::uint16_t kAdoptedWeight = 1;

// Preference of each label when layers are flattened; the greatest wins. A segment without a tissue that is
// nested in touchable ones, e.g. a target volume in an organ, adopts the tissue of the smallest of them.
std::vector<std::uint16_t> preferences(const LabelMap& labels, std::span<const SegmentOverlap> overlaps,
                                       const std::vector<std::uint8_t>& weight_of_label, ModelParts& parts) {
  std::vector<std::uint16_t> preference(weight_of_label.begin(), weight_of_label.end());
  for (std::uint16_t& weight : preference)
    if (weight > 0) weight += kAdoptedWeight;
  std::map<LabelId, std::size_t> voxels;
  for (const SegmentStatistics& of : segment_statistics(labels)) voxels[of.id] = of.voxels;
  std::map<LabelId, LabelId> smallest_around;
  for (const SegmentOverlap& overlap : overlaps) {
    if (!overlap.is_nested() || weight_of_label[overlap.larger] == 0) continue;
    if (tissue_index(parts, overlap.smaller) >= 0) continue;
    const auto [around, is_first] = smallest_around.try_emplace(overlap.smaller, overlap.larger);
    if (!is_first && voxels[overlap.larger] < voxels[around->second]) around->second = overlap.larger;
  }
  for (const auto& [label, around] : smallest_around) {
    set_label(parts, label, static_cast<std::size_t>(tissue_index(parts, around)));
    preference[label] = kAdoptedWeight;
  }
  return preference;
}

// Flattens the layers to one label per voxel.
Volume<LabelId> flatten_by_weight(LabelMap labels, const std::vector<std::uint8_t>& weight_of_label,
                                  ModelParts& parts, std::vector<std::vector<LabelId>>& enclosing) {
  if (labels.layers.size() == 1) {
    const bool as_it_is = std::all_of(labels.segments.begin(), labels.segments.end(),
                                      [](const Segment& s) { return s.id == s.value; });
    return as_it_is ? std::move(labels.layers.front()) : labels.flattened();
  }
  const std::vector<SegmentOverlap> overlaps = segment_overlaps(labels);
  enclosing = enclosing_segments(overlaps);
  return flatten(labels, overlaps, preferences(labels, overlaps, weight_of_label, parts));
}

// smoothing weight of each label
Volume<std::uint8_t> weights_of(const Volume<LabelId>& flat, const ModelParts& parts,
                                double stiffest_N_per_mm) {
  std::vector<std::uint8_t> weight_of_label(65536, 0);
  for (std::size_t label = 0; label < parts.tissue_of_label.size(); ++label)
    if (const int tissue = parts.tissue_of_label[label]; tissue >= 0) {
      const Tissue& own = parts.tissues[static_cast<std::size_t>(tissue)];
      if (own.touchable) weight_of_label[label] = weight_of(own, stiffest_N_per_mm);
    }
  return weigh_labels(flat, weight_of_label);
}

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

// No-go regions of the scene; a [[no_go]] of structures gives one region per structure.
// @param ids  structures of each [[no_go]] (resolve_no_go); empty: there is no label map
Result<std::vector<NoGoRegion>> no_go_of(const Scene& scene, const std::vector<std::vector<LabelId>>& ids,
                                         const std::vector<Segment>& segments,
                                         const std::vector<std::size_t>& voxels) {
  std::vector<NoGoRegion> regions;
  for (std::size_t n = 0; n < scene.no_go.size(); ++n) {
    const NoGoSettings& settings = scene.no_go[n];
    const auto add = [&](const std::string& name, auto shape) {
      regions.push_back({name, shape, settings.keep_away_mm, settings.stiffness_N_per_mm});
    };
    if (const auto* plane = std::get_if<NoGoPlane>(&settings.shape)) add(settings.name, *plane);
    if (const auto* ball = std::get_if<NoGoSphere>(&settings.shape)) add(settings.name, *ball);
    if (settings.structures.empty()) continue;
    const auto wrong = [&](const std::string& what, std::string remedy) {
      return Error{ErrorKind::kBadInput, "no-go region \"" + settings.name + "\" " + what,
                   scene.where(settings.line), std::move(remedy)};
    };
    if (ids.empty()) return wrong("has structures, but there is no label map", "make it a plane or a ball");
    for (const LabelId id : ids[n]) {
      const auto segment =
          std::find_if(segments.begin(), segments.end(), [&](const Segment& s) { return s.id == id; });
      const std::string structure =
          segment != segments.end() && !segment->name.empty() ? segment->name : "label " + std::to_string(id);
      if (voxels[id] == 0)
        return wrong("has the structure " + structure + ", which has no voxel outside other structures",
                     "leave it out, or draw it where it is not covered by another structure");
      add(ids[n].size() > 1 ? settings.name + ": " + structure : settings.name, NoGoStructure{id, -1});
    }
  }
  if (auto fine = check_no_go(regions); !fine) return fine.error();
  return regions;
}

// Structures with published distances. No-go structures are always included, because the user needs their
// distance before the tool is pushed back.
ReportedDistances reported_distances_of(const DistanceSettings& settings, const ModelParts& parts,
                                        const std::vector<std::size_t>& voxels) {
  ReportedDistances distances;
  distances.reach_mm = settings.reach_mm;
  const auto is_protected_from = [&](std::size_t label) {
    return std::ranges::any_of(parts.no_go, [&](const NoGoRegion& region) {
      const auto* structure = std::get_if<NoGoStructure>(&region.shape);
      return structure != nullptr && structure->label == label;
    });
  };
  const auto is_chosen = [&](std::size_t label) {
    const int tissue = label < parts.tissue_of_label.size() ? parts.tissue_of_label[label] : -1;
    const bool touchable = tissue >= 0 && parts.tissues[static_cast<std::size_t>(tissue)].touchable;
    return settings.structures == ReportedStructures::kAll ||
           (touchable && settings.structures == ReportedStructures::kTouchable);
  };
  for (std::size_t label = 1; label < voxels.size(); ++label)
    if (voxels[label] > 0 && (is_chosen(label) || is_protected_from(label)))
      distances.structures.push_back(static_cast<LabelId>(label));
  return distances;
}

LabelId generated_label(std::size_t tissue) {
  return static_cast<LabelId>(kFirstThresholdLabel + tissue);
}

// Assigns the unlabelled voxels inside the body to the embedding of the scene. Error kBadInput if there are
// none.
Result<void> embed(const Scene& scene, const Volume<float>* scan, ModelParts& parts, Volume<LabelId>& flat,
                   const Progress& progress) {
  const auto settings = std::ranges::find_if(scene.tissues, &TissueSettings::embedding);
  if (settings == scene.tissues.end()) return {};
  const auto tissue = static_cast<std::size_t>(settings - scene.tissues.begin());
  const LabelId id = generated_label(tissue);
  const auto body = body_mask(flat, scan, settings->air_below, progress);
  if (!body) return body.error();
  std::size_t embedded = 0;
  for (std::size_t v = 0; v < body->size(); ++v) {
    if ((*body)[v] == 0 || flat.voxels()[v] != 0) continue;
    flat.voxels()[v] = id;
    ++embedded;
  }
  if (embedded == 0)
    return Error{ErrorKind::kBadInput,
                 "no unlabelled voxel lies inside the body, so \"" + settings->name + "\" is empty",
                 scene.where(settings->line),
                 scan ? "check air_below of the tissue, or leave the tissue out"
                      : "name the scan under [data] and give the tissue air_below, or leave the tissue out"};
  set_label(parts, id, tissue);
  parts.segments.push_back({id, settings->name, settings->colour.value_or(Rgb{230, 210, 180}), 0, id});
  return {};
}

// adds the embedding to the weights from which a field is smoothed
void weigh_embedding(const Scene& scene, const Volume<LabelId>& flat, const ModelParts& parts,
                     double stiffest_N_per_mm, Volume<std::uint8_t>& weights) {
  const auto settings = std::ranges::find_if(scene.tissues, &TissueSettings::embedding);
  if (settings == scene.tissues.end() || !settings->touchable) return;
  const auto tissue = static_cast<std::size_t>(settings - scene.tissues.begin());
  const std::uint8_t weight = weight_of(parts.tissues[tissue], stiffest_N_per_mm);
  for (std::size_t v = 0; v < flat.voxels().size(); ++v)
    if (flat.voxels()[v] == generated_label(tissue)) weights.voxels()[v] = weight;
}

// inputs of the model, with labels in bricks, and the weights from which its field is smoothed
struct ReadyParts {
  ModelParts parts;
  std::shared_ptr<const Volume<float>> scan;
  Volume<std::uint8_t> weights;                 // empty for ramps
  std::vector<std::vector<LabelId>> enclosing;  // Model::enclosing
};

Result<ReadyParts> ready_parts(const Scene& scene, SceneVolumes& volumes, const Progress& progress,
                               const Warn& warn) {
  // on the finer grid: the resampled volume, flattened layers, weights, and bricks in the worst case
  constexpr std::uint64_t kBytesPerVoxel = 9;
  const GridGeometry* finer = volumes.labels ? &volumes.labels->geometry() : &volumes.scan->geometry();
  if (volumes.labels && volumes.scan)
    finer = &field_grid(&volumes.labels->geometry(), &volumes.scan->geometry());
  if (auto allowed = check_memory(finer->voxel_count() * kBytesPerVoxel, scene.source); !allowed)
    return allowed.error();
  if (auto common = resample_to_common_grid(volumes, progress, warn); !common) {
    Error error = common.error();
    if (error.where.empty()) error.where = scene.source;
    return error;
  }
  ReadyParts ready;
  ready.scan = std::move(volumes.scan);
  const std::shared_ptr<const Volume<float>>& scan = ready.scan;
  Volume<std::uint8_t>& weights = ready.weights;
  ModelParts& parts = ready.parts;
  parts.title = scene.title;
  parts.sigma_mm = scene.preparation.sigma_mm;
  parts.method_settings = scene.force.settings;
  parts.tissue_law = scene.deformation.law;
  parts.tissue_cell_mm = scene.deformation.cell_mm.value_or(0);
  parts.tools = scene.tools;
  parts.full_density_HU = scene.full_density_HU.value_or(0);
  if (scene.max_force_N) parts.max_force_N = *scene.max_force_N;
  parts.ramp_width_mm = scene.preparation.ramp_width_mm;
  parts.eight_bits = scene.preparation.storage == FieldStorage::k8Bit;
  for (const TissueSettings& settings : scene.tissues)
    parts.tissues.push_back(tissue_of(settings, scene.tissues));

  // weights are relative to the stiffest tissue; 0 if none is touchable
  double stiffest = 0;
  for (const Tissue& tissue : parts.tissues)
    if (tissue.touchable) stiffest = std::max(stiffest, tissue.stiffness_N_per_mm);
  if (stiffest == 0) stiffest = 1;

  // each label gets the weight of its tissue
  const GridGeometry grid = volumes.labels ? volumes.labels->geometry() : scan->geometry();
  const bool ramps = scene.preparation.method == PreparationMethod::kInwardRamp;
  std::vector<std::uint8_t> weight_of_label(65536, 0);
  Volume<LabelId> flat;
  std::vector<std::vector<LabelId>> no_go_ids;
  if (volumes.labels) {
    auto protected_labels = resolve_no_go(scene, *volumes.labels);
    if (!protected_labels) return protected_labels.error();
    no_go_ids = *std::move(protected_labels);
    auto ids = resolve_labels(scene, *volumes.labels);
    if (!ids) return ids.error();
    for (std::size_t t = 0; t < ids->size(); ++t)
      for (const LabelId id : (*ids)[t]) {
        set_label(parts, id, t);
        if (parts.tissues[t].touchable) weight_of_label[id] = weight_of(parts.tissues[t], stiffest);
      }
    progress.report("preparing labels", 0);
    parts.segments = volumes.labels->segments;
    flat = flatten_by_weight(*std::move(volumes.labels), weight_of_label, parts, ready.enclosing);
    volumes.labels.reset();
    // inward ramps only need labels
    if (!ramps) weights = weights_of(flat, parts, stiffest);
  } else {
    if (!ramps) weights = Volume<std::uint8_t>(grid);
    flat = Volume<LabelId>(grid);
  }

  // thresholds on the raw scan: the field is a ramp on its values; the structure is the region above the
  // middle of the ramp, and where tissues overlap the one with the highest weight
  for (std::size_t t = 0; t < scene.tissues.size(); ++t) {
    const TissueSettings& settings = scene.tissues[t];
    if (!settings.threshold) continue;
    if (!scan)
      return Error{ErrorKind::kBadInput,
                   "tissue '" + settings.name + "' has a threshold but the scene has no scan",
                   scene.source + ":" + std::to_string(settings.line), "name the scan under [data]"};
    const auto [low, high] = *settings.threshold;
    const bool touchable = parts.tissues[t].touchable;
    const std::uint8_t weight = weight_of(parts.tissues[t], stiffest);
    const LabelId id = generated_label(t);
    set_label(parts, id, t);
    if (touchable) weight_of_label[id] = weight;
    parts.segments.push_back({id, settings.name, settings.colour.value_or(Rgb{230, 210, 180}), 0, id});
    Volume<std::uint8_t> ramp;
    if (!ramps) ramp = ramp_scan(*scan, low, high, weight / 255.0);
    bool reached = false;
    for (std::size_t v = 0; v < flat.voxels().size(); ++v) {
      if (touchable && !ramps) weights.voxels()[v] = std::max(weights.voxels()[v], ramp.voxels()[v]);
      if (!(scan->voxels()[v] >= 0.5 * (low + high))) continue;
      reached = true;
      LabelId& current = flat.voxels()[v];
      if (current == 0 || weight_of_label[id] > weight_of_label[current]) current = id;
    }
    if (!reached && warn)
      warn("no voxel of the scan reaches " + std::to_string(std::lround(0.5 * (low + high))) +
           ", the middle of tissue '" + settings.name + "'");
  }
  if (auto embedded = embed(scene, scan.get(), parts, flat, progress); !embedded) return embedded.error();
  if (!ramps) weigh_embedding(scene, flat, parts, stiffest, weights);
  std::sort(parts.segments.begin(), parts.segments.end(),
            [](const Segment& a, const Segment& b) { return a.id < b.id; });
  std::vector<std::optional<Rgb>> declared;
  for (const TissueSettings& settings : scene.tissues) declared.push_back(settings.colour);
  apply_tissue_colours(parts.segments, parts.tissue_of_label, declared);

  parts.labels = label_bricks(flat);
  const std::vector<std::size_t> voxels = label_counts(*parts.labels);
  auto no_go = no_go_of(scene, no_go_ids, parts.segments, voxels);
  if (!no_go) return no_go.error();
  parts.no_go = *std::move(no_go);
  parts.reported_distances = reported_distances_of(scene.distances, parts, voxels);
  return ready;
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
