#include "loading/cached_preparation.h"

#include <algorithm>
#include <cmath>
#include <new>

#include "palpate/base/for_each_index.h"
#include "palpate/base/reading.h"
#include "palpate/cache/entries.h"
#include "palpate/cache/fields.h"
#include "palpate/volume/resample.h"

namespace palpate {
namespace {

using cache::FieldReader;
using cache::FieldWriter;

void report_found(const Progress& progress) {
  progress.report("loading the prepared scene from the cache", 0);
}

void put_grid(const GridGeometry& grid, auto& out) {
  for (const int dim : grid.dims) out.put(dim);
  for (int axis = 0; axis < 3; ++axis) {
    out.put(grid.spacing_mm[axis]);
    out.put(grid.origin[axis]);
    for (int column = 0; column < 3; ++column) out.put(grid.direction(axis, column));
  }
}

// Reads a grid. Empty if it is invalid or too large for the memory: the entry is corrupt.
std::optional<GridGeometry> get_grid(FieldReader& in, std::size_t bytes_per_voxel) {
  GridGeometry grid;
  for (int& dim : grid.dims) in.get(dim);
  bool good = true;
  for (int axis = 0; axis < 3; ++axis) {
    in.get(grid.spacing_mm[axis]);
    in.get(grid.origin[axis]);
    good = good && std::isfinite(grid.spacing_mm[axis]) && grid.spacing_mm[axis] > 0 &&
           std::isfinite(grid.origin[axis]);
    for (int column = 0; column < 3; ++column) in.get(grid.direction(axis, column));
  }
  constexpr int kMaxAlong = 1 << 16;
  for (const int dim : grid.dims) good = good && dim > 0 && dim <= kMaxAlong;
  const double volume = std::abs(grid.direction.determinant());
  good = good && in.ok() && std::isfinite(volume) && volume > 1e-9;
  if (!good || !check_memory(grid.voxel_count() * bytes_per_voxel, "the cache")) return std::nullopt;
  return grid;
}

template <class T>
void put_voxels(const Volume<T>& volume, FieldWriter& out) {
  out.put_values(std::span<const T>(volume.voxels()));
}
template <class T>
void get_voxels(FieldReader& in, Volume<T>& volume) {
  in.get_values(std::span<T>(volume.voxels()));
}

// writes bricks slice by slice
template <class T>
void put_bricks(const Bricks<T>& bricks, FieldWriter& out) {
  const std::array<int, 3>& dims = bricks.geometry().dims;
  std::vector<T> slice(static_cast<std::size_t>(dims[0]) * static_cast<std::size_t>(dims[1]));
  for (int k = 0; k < dims[2]; ++k) {
    for (int j = 0; j < dims[1]; ++j)
      bricks.copy_row(0, j, k, dims[0], slice.data() + static_cast<std::ptrdiff_t>(j) * dims[0]);
    out.put_values(std::span<const T>(slice));
  }
}
// the result is only valid if the reader is ok() afterwards
template <class T>
Bricks<T> get_bricks(FieldReader& in, const GridGeometry& grid, T outside) {
  BricksBuilder<T> bricks(grid, outside);
  std::vector<T> slice(static_cast<std::size_t>(grid.dims[0]) * static_cast<std::size_t>(grid.dims[1]));
  for (int k = 0; k < grid.dims[2]; ++k) {
    in.get_values(std::span<T>(slice));
    if (!in.ok()) return {};
    bricks.add(1, slice.data());
  }
  return bricks.take();
}

// Looks up a cached result. A missing, truncated or invalid entry counts as a cache miss.
// @param read  deserialises the payload; empty if it is invalid
template <class Kept, class Read>
std::optional<Kept> find_cached(const std::optional<cache::Digest>& key, const Read& read) try {
  if (!key) return std::nullopt;
  const auto payload = cache::find(*key);
  if (!payload) return std::nullopt;
  FieldReader in(payload->bytes());
  std::optional<Kept> stored = read(in);
  return stored && in.finished() ? std::move(stored) : std::nullopt;
} catch (const std::bad_alloc&) {
  return std::nullopt;
}

// Stores a result in the cache.
// @param write  serialises the result into a FieldWriter
template <class Write>
void store_result(const std::optional<cache::Digest>& key, const Write& write) try {
  if (!key) return;
  FieldWriter out;
  write(out);
  cache::store(*key, out.bytes());
} catch (const std::bad_alloc&) {
  // not cached; the next run prepares it again
}

cache::Key key_of_labels(std::string_view kind, const cache::Digest& of_labels) {
  cache::Key key(kind, kPreparationVersion);
  key.put(of_labels);
  return key;
}

// ---- ramps ---------------------------------------------------------------------------------------

std::optional<cache::Digest> key_of_ramps(const std::optional<cache::Digest>& of_labels,
                                          const std::vector<RampStructure>& structures,
                                          const RampOptions& options) {
  if (!of_labels) return std::nullopt;
  cache::Key key = key_of_labels("ramps", *of_labels);
  key.put(options.stiffest_N_per_mm);
  key.put(options.width_mm);
  for (const RampStructure& structure : structures) {
    key.put(structure.label);
    key.put(structure.stiffness_N_per_mm);
    key.put(structure.rests_on.size());
    for (const LabelId support : structure.rests_on) key.put(support);
  }
  return key.digest();
}

void put_ramps(const Ramps& ramps, FieldWriter& out) {
  put_bricks(ramps.field, out);
  out.put(ramps.full_force_N);
  out.put(static_cast<std::uint32_t>(ramps.structures.size()));
  for (const RampStatistics& figures : ramps.structures) {
    out.put(figures.label);
    out.put(figures.max_N);
    out.put(figures.half_thickness_mm);
  }
}

std::optional<Ramps> get_ramps(FieldReader& in, const Bricks<LabelId>& labels,
                               const std::vector<RampStructure>& structures) {
  Ramps ramps;
  ramps.field = get_bricks<std::uint16_t>(in, labels.geometry(), 0);
  in.get(ramps.full_force_N);
  std::uint32_t count = 0;
  in.get(count);
  if (!in.ok() || !std::isfinite(ramps.full_force_N) || count > structures.size()) return std::nullopt;
  for (std::uint32_t n = 0; n < count; ++n) {
    RampStatistics figures;
    in.get(figures.label);
    in.get(figures.max_N);
    in.get(figures.half_thickness_mm);
    const bool known = std::any_of(structures.begin(), structures.end(),
                                   [&](const RampStructure& s) { return s.label == figures.label; });
    if (!in.ok() || !known || !std::isfinite(figures.max_N) || !std::isfinite(figures.half_thickness_mm))
      return std::nullopt;
    ramps.structures.push_back(figures);
  }
  return ramps;
}

// ---- smoothed weights ----------------------------------------------------------------------------

template <class T, class Smooth>
Result<Volume<T>> cached_smoothed(const Volume<std::uint8_t>& weights, const GaussianOptions& options,
                                  const Progress& progress, const Smooth& smooth) {
  std::optional<cache::Digest> key;
  if (cache::is_cache_enabled()) {
    if (const auto of_weights = cache::digest_of(weights.voxels())) {
      cache::Key parts("smoothed", kPreparationVersion);
      parts.put(*of_weights);
      put_grid(weights.geometry(), parts);
      parts.put(sizeof(T));
      parts.put(options.sigma_mm);
      parts.put(options.engine);
      key = parts.digest();
    }
  }
  auto stored = find_cached<Volume<T>>(key, [&](FieldReader& in) {
    Volume<T> volume(weights.geometry());
    get_voxels(in, volume);
    return std::optional(std::move(volume));
  });
  if (stored) {
    report_found(progress);
    return *std::move(stored);
  }
  auto smoothed = smooth(weights, options, progress);
  if (smoothed) store_result(key, [&](FieldWriter& out) { put_voxels(*smoothed, out); });
  return smoothed;
}

// ---- surfaces ------------------------------------------------------------------------------------

std::optional<cache::Digest> key_of_surface(const cache::Digest& of_labels, const std::vector<LabelId>& group,
                                            const SurfaceOptions& options) {
  cache::Key key = key_of_labels("surface", of_labels);
  for (const double value : {options.reach_mm, options.position_sigma_mm, options.normal_sigma_mm,
                             options.stray_below_mm3, options.drop_below_mm3})
    key.put(value);
  for (const LabelId label : group) key.put(label);
  return key.digest();
}

void put_field(const SignedField& field, FieldWriter& out) {
  put_grid(field.geometry(), out);
  out.put(field.steps().scale);
  out.put(field.steps().offset);
  out.put(field.steps().outside);
  put_bricks(field.bricks(), out);
}

std::optional<SignedField> get_field(FieldReader& in) {
  const auto grid = get_grid(in, 2 * sizeof(std::int16_t));
  if (!grid) return std::nullopt;
  SignedSteps steps;
  in.get(steps.scale);
  in.get(steps.offset);
  in.get(steps.outside);
  if (!in.ok() || !std::isfinite(steps.scale) || !std::isfinite(steps.offset)) return std::nullopt;
  auto voxels = get_bricks(in, *grid, steps.outside);
  if (!in.ok()) return std::nullopt;
  return SignedField(std::move(voxels), steps);
}

void put_surface(const Surface& surface, FieldWriter& out) {
  put_field(surface.distance_field(), out);
  put_field(surface.normal_field(), out);
  out.put(surface.max_gradient());
  out.put(surface.content_hash());
}

std::optional<std::shared_ptr<const Surface>> get_surface(FieldReader& in) {
  auto position = get_field(in);
  if (!position) return std::nullopt;
  auto normal = get_field(in);
  if (!normal) return std::nullopt;
  double max_gradient = 0;
  std::uint64_t hash = 0;
  in.get(max_gradient);
  in.get(hash);
  if (!in.ok() || !std::isfinite(max_gradient)) return std::nullopt;
  auto surface = std::make_shared<const Surface>(*std::move(position), *std::move(normal), max_gradient);
  if (surface->content_hash() != hash) return std::nullopt;
  return std::shared_ptr<const Surface>(std::move(surface));
}

// ---- resampling ----------------------------------------------------------------------------------

// empty if a digest cannot be computed
template <class T>
std::optional<cache::Key> key_of_resampled(std::string_view kind, std::span<const Volume<T>* const> volumes,
                                           const GridGeometry& grid) {
  if (!cache::is_cache_enabled()) return std::nullopt;
  cache::Key key(kind, kPreparationVersion);
  put_grid(grid, key);
  for (const Volume<T>* volume : volumes) {
    const auto digest = cache::digest_of(volume->voxels());
    if (!digest) return std::nullopt;
    key.put(*digest);
    put_grid(volume->geometry(), key);
  }
  return key;
}

// Adds digests of all voxels, computed in parallel for a group of slices at a time. False if a digest cannot
// be computed.
bool put_digests_of_voxels(const Bricks<LabelId>& labels, cache::Key& key) {
  constexpr std::size_t kAtOnce = std::size_t{1} << 21;
  const std::array<int, 3>& dims = labels.geometry().dims;
  const std::size_t slice = static_cast<std::size_t>(dims[0]) * static_cast<std::size_t>(dims[1]);
  const int slices = static_cast<int>(std::max<std::size_t>(1, kAtOnce / std::max<std::size_t>(1, slice)));
  const int count = (dims[2] + slices - 1) / slices;
  std::vector<std::optional<cache::Digest>> digests(static_cast<std::size_t>(count));
  for_each_index(count, worker_count(0, count), [&](int /*worker*/, int index) {
    const int begin = index * slices, end = std::min(dims[2], begin + slices);
    std::vector<LabelId> voxels(slice * static_cast<std::size_t>(end - begin));
    LabelId* row = voxels.data();
    for (int k = begin; k < end; ++k)
      for (int j = 0; j < dims[1]; ++j, row += dims[0]) labels.copy_row(0, j, k, dims[0], row);
    digests[static_cast<std::size_t>(index)] = cache::digest_of(voxels);
    return true;
  });
  for (const auto& digest : digests) {
    if (!digest) return false;
    key.put(*digest);
  }
  return true;
}

// ---- phantoms ------------------------------------------------------------------------------------

// the parameters are numbers and names of generated structures; the key contains only their digest
std::optional<cache::Digest> key_of_phantom(const PhantomParameters& parameters) {
  if (!cache::is_cache_enabled()) return std::nullopt;
  cache::Key key("phantom", kPreparationVersion);
  key.put(phantom_name(parameters));
  return key.digest();
}

}  // namespace

const std::optional<cache::Digest>& CachedPreparation::digest_of(const Bricks<LabelId>& labels) const {
  if (labels_ == &labels) return labels_digest_;
  labels_ = &labels;
  labels_digest_.reset();
  if (!cache::is_cache_enabled()) return labels_digest_;
  cache::Key key("labels", kPreparationVersion);
  put_grid(labels.geometry(), key);
  if (put_digests_of_voxels(labels, key)) labels_digest_ = key.digest();
  return labels_digest_;
}

Result<Ramps> CachedPreparation::ramps(const Bricks<LabelId>& labels,
                                       const std::vector<RampStructure>& structures,
                                       const RampOptions& options, const Progress& progress) const {
  const auto key = key_of_ramps(digest_of(labels), structures, options);
  auto stored = find_cached<Ramps>(key, [&](FieldReader& in) { return get_ramps(in, labels, structures); });
  if (stored) {
    report_found(progress);
    return *std::move(stored);
  }
  auto ramps = ModelPreparation::ramps(labels, structures, options, progress);
  if (ramps) store_result(key, [&](FieldWriter& out) { put_ramps(*ramps, out); });
  return ramps;
}

Result<Volume<std::uint8_t>> cached_smooth(const Volume<std::uint8_t>& weights,
                                           const GaussianOptions& options, const Progress& progress) {
  return cached_smoothed<std::uint8_t>(weights, options, progress,
                                       [](const Volume<std::uint8_t>& w, const GaussianOptions& o,
                                          const Progress& p) { return gaussian_smooth(w, o, p); });
}

Result<Volume<std::uint16_t>> cached_smooth_16(const Volume<std::uint8_t>& weights,
                                               const GaussianOptions& options, const Progress& progress) {
  return cached_smoothed<std::uint16_t>(weights, options, progress,
                                        [](const Volume<std::uint8_t>& w, const GaussianOptions& o,
                                           const Progress& p) { return gaussian_smooth_16(w, o, p); });
}

Result<std::vector<std::pair<LabelId, LabelId>>> CachedPreparation::touching_pairs(
    const Bricks<LabelId>& labels, const std::vector<LabelId>& structures, const Progress& progress) const {
  using Pairs = std::vector<std::pair<LabelId, LabelId>>;
  std::optional<cache::Digest> key;
  if (const auto& of_labels = digest_of(labels)) {
    cache::Key parts = key_of_labels("touching", *of_labels);
    for (const LabelId label : structures) parts.put(label);
    key = parts.digest();
  }
  const auto is_structure = [&](LabelId label) {
    return std::find(structures.begin(), structures.end(), label) != structures.end();
  };
  auto stored = find_cached<Pairs>(key, [&](FieldReader& in) -> std::optional<Pairs> {
    Pairs pairs;
    std::uint32_t count = 0;
    in.get(count);
    for (std::uint32_t n = 0; n < count && in.ok(); ++n) {
      std::pair<LabelId, LabelId> pair;
      in.get(pair.first);
      in.get(pair.second);
      if (!is_structure(pair.first) || !is_structure(pair.second)) return std::nullopt;
      pairs.push_back(pair);
    }
    return pairs;
  });
  if (stored) {
    report_found(progress);
    return *std::move(stored);
  }
  auto pairs = ModelPreparation::touching_pairs(labels, structures, progress);
  if (pairs)
    store_result(key, [&](FieldWriter& out) {
      out.put(static_cast<std::uint32_t>(pairs->size()));
      for (const auto& [a, b] : *pairs) {
        out.put(a);
        out.put(b);
      }
    });
  return pairs;
}

Result<std::vector<std::shared_ptr<const Surface>>> CachedPreparation::outer_surfaces(
    const Bricks<LabelId>& labels, const std::vector<std::vector<LabelId>>& groups,
    const SurfaceOptions& options, const Progress& progress) const {
  std::vector<std::shared_ptr<const Surface>> surfaces(groups.size());
  std::vector<std::optional<cache::Digest>> keys(groups.size());
  const auto count = static_cast<int>(groups.size());
  if (const auto& of_labels = digest_of(labels)) {
    for_each_index(count, worker_count(0, count), [&](int /*worker*/, int index) {
      const auto g = static_cast<std::size_t>(index);
      keys[g] = key_of_surface(*of_labels, groups[g], options);
      if (auto stored = find_cached<std::shared_ptr<const Surface>>(keys[g], get_surface))
        surfaces[g] = *std::move(stored);
      return !progress.stopped();
    });
    if (progress.stopped()) return Progress::interrupted();
  }

  std::vector<std::vector<LabelId>> missing;
  std::vector<std::size_t> indices;
  for (std::size_t g = 0; g < groups.size(); ++g) {
    if (surfaces[g]) continue;
    missing.push_back(groups[g]);
    indices.push_back(g);
  }
  if (missing.size() < groups.size()) report_found(progress);
  // completed groups are cached even if the preparation is interrupted afterwards
  for (const std::vector<std::size_t>& batch : disjoint_batches(missing)) {
    std::vector<std::vector<LabelId>> together;
    for (const std::size_t n : batch) together.push_back(missing[n]);
    auto prepared = ModelPreparation::outer_surfaces(labels, together, options, progress);
    if (!prepared) return prepared.error();
    for (std::size_t n = 0; n < batch.size(); ++n) {
      const std::size_t g = indices[batch[n]];
      surfaces[g] = std::move((*prepared)[n]);
      store_result(keys[g], [&](FieldWriter& out) { put_surface(*surfaces[g], out); });
    }
  }
  return surfaces;
}

Result<Volume<float>> cached_resampled(const Volume<float>& scan, const GridGeometry& grid, float outside,
                                       const Progress& progress) {
  const Volume<float>* const volumes[] = {&scan};
  auto parts = key_of_resampled<float>("resampled scan", volumes, grid);
  if (parts) parts->put(outside);
  const auto key = parts ? parts->digest() : std::nullopt;
  auto stored = find_cached<Volume<float>>(key, [&](FieldReader& in) {
    Volume<float> volume(grid);
    get_voxels(in, volume);
    return std::optional(std::move(volume));
  });
  if (stored) {
    report_found(progress);
    return *std::move(stored);
  }
  auto resampled = resample_linear(scan, grid, outside);
  if (resampled) store_result(key, [&](FieldWriter& out) { put_voxels(*resampled, out); });
  return resampled;
}

Result<LabelMap> cached_resampled(const LabelMap& labels, const GridGeometry& grid,
                                  const Progress& progress) {
  std::vector<const Volume<LabelId>*> layers;
  for (const Volume<LabelId>& layer : labels.layers) layers.push_back(&layer);
  const auto parts = key_of_resampled<LabelId>("resampled labels", layers, grid);
  const auto key = parts ? parts->digest() : std::nullopt;
  auto stored = find_cached<LabelMap>(key, [&](FieldReader& in) {
    LabelMap map{std::vector<Volume<LabelId>>(layers.size(), Volume<LabelId>(grid)), labels.segments};
    for (Volume<LabelId>& layer : map.layers) get_voxels(in, layer);
    return std::optional(std::move(map));
  });
  if (stored) {
    report_found(progress);
    return *std::move(stored);
  }
  auto resampled = resample_nearest(labels, grid);
  if (resampled)
    store_result(key, [&](FieldWriter& out) {
      for (const Volume<LabelId>& layer : resampled->layers) put_voxels(layer, out);
    });
  return resampled;
}

Result<Phantom> cached_phantom(const PhantomParameters& parameters, const Progress& progress) {
  const auto key = key_of_phantom(parameters);
  auto stored = find_cached<Phantom>(key, [&](FieldReader& in) -> std::optional<Phantom> {
    const auto plain = phantom_without_voxels(parameters);
    if (!plain || !check_memory(plain->grid.voxel_count() * (sizeof(LabelId) + sizeof(float)), "the cache"))
      return std::nullopt;
    Phantom phantom{{{Volume<LabelId>(plain->grid)}, plain->segments}, Volume<float>(plain->grid)};
    get_voxels(in, phantom.labels.layers.front());
    get_voxels(in, phantom.scan);
    return phantom;
  });
  if (stored) {
    report_found(progress);
    return *std::move(stored);
  }
  auto phantom = make_phantom(parameters, progress);
  if (phantom)
    store_result(key, [&](FieldWriter& out) {
      put_voxels(phantom->labels.layers.front(), out);
      put_voxels(phantom->scan, out);
    });
  return phantom;
}

}  // namespace palpate
