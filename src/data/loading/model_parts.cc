#include "loading/model_parts.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "loading/body.h"
#include "loading/cached_preparation.h"
#include "palpate/base/reading.h"
#include "palpate/contact/colours.h"
#include "palpate/model/ramp_structures.h"
#include "palpate/preparation/preparation.h"
#include "palpate/volume/overlaps.h"

namespace palpate {
namespace {

// label ids of structures defined by threshold or embedding: above those used by typical segmentations
constexpr LabelId kFirstThresholdLabel = 60000;

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

// settings of the scene that do not depend on its volumes
void copy_settings(const Scene& scene, ModelParts& parts) {
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
}

// stiffness relative to which weights are given: that of the stiffest tissue; 1 if none is touchable
double stiffest_N_per_mm_of(const std::vector<Tissue>& tissues) {
  double stiffest = 0;
  for (const Tissue& tissue : tissues)
    if (tissue.touchable) stiffest = std::max(stiffest, tissue.stiffness_N_per_mm);
  return stiffest == 0 ? 1 : stiffest;
}

// a scene's labels while its parts are made
struct Labelling {
  double stiffest_N_per_mm = 1;
  std::vector<std::uint8_t> weight_of_label = std::vector<std::uint8_t>(65536, 0);
  Volume<LabelId> flat;                         // one label per voxel
  std::vector<std::vector<LabelId>> no_go_ids;  // structures of each [[no_go]]; empty without a label map
};

// Labels by the label map, which it consumes: each label gets the weight of its tissue.
Result<void> label_by_map(const Scene& scene, SceneVolumes& volumes, const Progress& progress,
                          ReadyParts& ready, Labelling& labelling) {
  ModelParts& parts = ready.parts;
  auto protected_labels = resolve_no_go(scene, *volumes.labels);
  if (!protected_labels) return protected_labels.error();
  labelling.no_go_ids = *std::move(protected_labels);
  auto ids = resolve_labels(scene, *volumes.labels);
  if (!ids) return ids.error();
  for (std::size_t t = 0; t < ids->size(); ++t)
    for (const LabelId id : (*ids)[t]) {
      set_label(parts, id, t);
      if (parts.tissues[t].touchable)
        labelling.weight_of_label[id] = weight_of(parts.tissues[t], labelling.stiffest_N_per_mm);
    }
  progress.report("preparing labels", 0);
  parts.segments = volumes.labels->segments;
  labelling.flat =
      flatten_by_weight(*std::move(volumes.labels), labelling.weight_of_label, parts, ready.enclosing);
  volumes.labels.reset();
  // inward ramps only need labels
  if (scene.preparation.method != PreparationMethod::kInwardRamp)
    ready.weights = weights_of(labelling.flat, parts, labelling.stiffest_N_per_mm);
  return {};
}

// Labels by thresholds on the raw scan, in addition: the field is a ramp on its values; the structure is the
// region above the middle of the ramp, and where tissues overlap the one with the highest weight.
Result<void> label_by_thresholds(const Scene& scene, const Warn& warn, ReadyParts& ready,
                                 Labelling& labelling) {
  ModelParts& parts = ready.parts;
  Volume<LabelId>& flat = labelling.flat;
  const Volume<float>* const scan = ready.scan.get();
  const bool ramps = scene.preparation.method == PreparationMethod::kInwardRamp;
  for (std::size_t t = 0; t < scene.tissues.size(); ++t) {
    const TissueSettings& settings = scene.tissues[t];
    if (!settings.threshold) continue;
    if (!scan)
      return Error{ErrorKind::kBadInput,
                   "tissue '" + settings.name + "' has a threshold but the scene has no scan",
                   scene.source + ":" + std::to_string(settings.line), "name the scan under [data]"};
    const auto [low, high] = *settings.threshold;
    const bool touchable = parts.tissues[t].touchable;
    const std::uint8_t weight = weight_of(parts.tissues[t], labelling.stiffest_N_per_mm);
    const LabelId id = generated_label(t);
    set_label(parts, id, t);
    if (touchable) labelling.weight_of_label[id] = weight;
    parts.segments.push_back({id, settings.name, settings.colour.value_or(Rgb{230, 210, 180}), 0, id});
    Volume<std::uint8_t> ramp;
    if (!ramps) ramp = ramp_scan(*scan, low, high, weight / 255.0);
    bool reached = false;
    for (std::size_t v = 0; v < flat.voxels().size(); ++v) {
      if (touchable && !ramps)
        ready.weights.voxels()[v] = std::max(ready.weights.voxels()[v], ramp.voxels()[v]);
      if (!(scan->voxels()[v] >= 0.5 * (low + high))) continue;
      reached = true;
      LabelId& current = flat.voxels()[v];
      if (current == 0 || labelling.weight_of_label[id] > labelling.weight_of_label[current]) current = id;
    }
    if (!reached && warn)
      warn("no voxel of the scan reaches " + std::to_string(std::lround(0.5 * (low + high))) +
           ", the middle of tissue '" + settings.name + "'");
  }
  return {};
}

}  // namespace

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
  ModelParts& parts = ready.parts;
  copy_settings(scene, parts);
  Labelling labelling;
  labelling.stiffest_N_per_mm = stiffest_N_per_mm_of(parts.tissues);
  Volume<LabelId>& flat = labelling.flat;
  const bool ramps = scene.preparation.method == PreparationMethod::kInwardRamp;
  if (volumes.labels) {
    if (auto labelled = label_by_map(scene, volumes, progress, ready, labelling); !labelled)
      return labelled.error();
  } else {
    if (!ramps) ready.weights = Volume<std::uint8_t>(ready.scan->geometry());
    flat = Volume<LabelId>(ready.scan->geometry());
  }
  if (auto labelled = label_by_thresholds(scene, warn, ready, labelling); !labelled) return labelled.error();
  if (auto embedded = embed(scene, ready.scan.get(), parts, flat, progress); !embedded)
    return embedded.error();
  if (!ramps) weigh_embedding(scene, flat, parts, labelling.stiffest_N_per_mm, ready.weights);
  std::sort(parts.segments.begin(), parts.segments.end(),
            [](const Segment& a, const Segment& b) { return a.id < b.id; });
  std::vector<std::optional<Rgb>> colours;
  for (const TissueSettings& settings : scene.tissues) colours.push_back(settings.colour);
  apply_tissue_colours(parts.segments, parts.tissue_of_label, colours);

  parts.labels = label_bricks(flat);
  const std::vector<std::size_t> voxels = label_counts(*parts.labels);
  auto no_go = no_go_of(scene, labelling.no_go_ids, parts.segments, voxels);
  if (!no_go) return no_go.error();
  parts.no_go = *std::move(no_go);
  parts.reported_distances = reported_distances_of(scene.distances, parts, voxels);
  return ready;
}

}  // namespace palpate
