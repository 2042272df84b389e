#include "servo/surface_matching.h"

#include <algorithm>

namespace palpate {
namespace {

std::size_t count_of(const Model& model) {
  return std::min(model.surfaces.size(), kMaxSurfaces);
}

// label of a structure's surface; 0 for an outer surface, which several structures share
LabelId label_of(const Model& model, std::size_t surface) {
  return surface < model.label_of_surface.size() ? model.label_of_surface[surface] : LabelId{0};
}

// content hash; 0 for a surface that has no distance field of its own
std::uint64_t content_of(const ContactSurface& surface) {
  return surface.surface != nullptr ? surface.surface->content_hash() : 0;
}

// index that satisfies `fits`, preferring the previous index; the number of entries if there is none
template <class Fits>
std::size_t index_where(std::size_t count, std::size_t previous, const Fits& fits) {
  if (previous < count && fits(previous)) return previous;
  std::size_t index = 0;
  while (index < count && !fits(index)) ++index;
  return index;
}

}  // namespace

std::span<const SurfaceCorrespondence> match_surfaces(const Model& model,
                                                      const SessionState::Surfaces& last_surfaces,
                                                      SurfaceMatches& storage) {
  const auto previous_count = static_cast<std::size_t>(last_surfaces.count);
  const std::size_t count = count_of(model);
  // after local edits alone every surface, common ones included, corresponds to the one at the same index
  const bool only_local_edits =
      count == previous_count && model.version - model.edits == last_surfaces.version - last_surfaces.edits;
  for (std::size_t s = 0; only_local_edits && s < count; ++s)
    storage[s] = {static_cast<std::int16_t>(s), last_surfaces.content[s] == content_of(model.surfaces[s])};
  for (std::size_t s = 0; !only_local_edits && s < count; ++s) {
    const LabelId label = label_of(model, s);
    const std::uint64_t content = content_of(model.surfaces[s]);
    // an outer surface of another shape counts as new, because the structures that it encloses may have
    // changed
    const auto is_structure = [&](std::size_t index) {
      return label != 0 && last_surfaces.label[index] == label;
    };
    const auto is_same = [&](std::size_t candidate) {
      return last_surfaces.label[candidate] == label && last_surfaces.content[candidate] == content;
    };
    std::size_t at_index = index_where(previous_count, s, is_same);
    const bool is_unchanged = at_index < previous_count;
    if (!is_unchanged) at_index = index_where(previous_count, s, is_structure);
    storage[s] = {at_index < previous_count ? static_cast<std::int16_t>(at_index) : std::int16_t{-1},
                  is_unchanged};
  }
  return std::span(storage).first(count);
}

void store_surfaces(const Model& model, SessionState::Surfaces& last_surfaces) {
  const std::size_t count = count_of(model);
  for (std::size_t s = 0; s < count; ++s) {
    last_surfaces.label[s] = label_of(model, s);
    last_surfaces.content[s] = content_of(model.surfaces[s]);
  }
  last_surfaces.count = static_cast<int>(count);
  last_surfaces.is_deformable = is_elastic(model.tissue_law);
  last_surfaces.version = model.version;
  last_surfaces.edits = model.edits;
}

}  // namespace palpate
