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
std::size_t index_where(std::size_t count, std::size_t stood, const Fits& fits) {
  if (stood < count && fits(stood)) return stood;
  std::size_t index = 0;
  while (index < count && !fits(index)) ++index;
  return index;
}

}  // namespace

std::span<const SurfaceCorrespondence> match_surfaces(const Model& model,
                                                      const SessionState::Surfaces& remembered,
                                                      SurfaceMatches& before) {
  const auto places = static_cast<std::size_t>(remembered.count);
  const std::size_t count = count_of(model);
  // after local edits alone every surface, common ones included, corresponds to the one at the same index
  const bool only_cut =
      count == places && model.version - model.edits == remembered.version - remembered.edits;
  for (std::size_t s = 0; only_cut && s < count; ++s)
    before[s] = {static_cast<std::int16_t>(s), remembered.content[s] == content_of(model.surfaces[s])};
  for (std::size_t s = 0; !only_cut && s < count; ++s) {
    const LabelId label = label_of(model, s);
    const std::uint64_t content = content_of(model.surfaces[s]);
    // an outer surface of another shape counts as new, because the structures that it encloses may have
    // changed
    const auto is_structure = [&](std::size_t index) {
      return label != 0 && remembered.label[index] == label;
    };
    const auto is_same = [&](std::size_t candidate) {
      return remembered.label[candidate] == label && remembered.content[candidate] == content;
    };
    std::size_t at_index = index_where(places, s, is_same);
    const bool same = at_index < places;
    if (!same) at_index = index_where(places, s, is_structure);
    before[s] = {at_index < places ? static_cast<std::int16_t>(at_index) : std::int16_t{-1}, same};
  }
  return std::span(before).first(count);
}

void remember_surfaces(const Model& model, SessionState::Surfaces& remembered) {
  const std::size_t count = count_of(model);
  for (std::size_t s = 0; s < count; ++s) {
    remembered.label[s] = label_of(model, s);
    remembered.content[s] = content_of(model.surfaces[s]);
  }
  remembered.count = static_cast<int>(count);
  remembered.is_deformable = is_elastic(model.tissue_law);
  remembered.version = model.version;
  remembered.edits = model.edits;
}

}  // namespace palpate
