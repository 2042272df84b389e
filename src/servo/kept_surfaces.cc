#include "servo/kept_surfaces.h"

#include <algorithm>

namespace palpate {
namespace {

std::size_t count_of(const Model& model) {
  return std::min(model.surfaces.size(), kMostSurfaces);
}

// the place that fits, the one where it stood before all others; the number of places where there is none
template <class Fits>
std::size_t place_where(std::size_t places, std::size_t stood, const Fits& fits) {
  if (stood < places && fits(stood)) return stood;
  std::size_t place = 0;
  while (place < places && !fits(place)) ++place;
  return place;
}

}  // namespace

std::span<const SurfaceBefore> find_before(const Model& model, const SessionState::Surfaces& remembered,
                                           SurfacesBefore& before) {
  const auto places = static_cast<std::size_t>(remembered.count);
  const std::size_t count = count_of(model);
  for (std::size_t s = 0; s < count; ++s) {
    const LabelId label = model.label_of_surface[s];
    const std::uint64_t content = model.surfaces[s].surface->content_hash();
    const auto is_structure = [&](std::size_t place) { return remembered.label[place] == label; };
    const auto is_same = [&](std::size_t place) {
      return is_structure(place) && remembered.content[place] == content;
    };
    std::size_t place = place_where(places, s, is_same);
    const bool same = place < places;
    if (!same) place = place_where(places, s, is_structure);
    before[s] = {place < places ? static_cast<std::int16_t>(place) : std::int16_t{-1}, same};
  }
  return std::span(before).first(count);
}

void remember_surfaces(const Model& model, SessionState::Surfaces& remembered) {
  const std::size_t count = count_of(model);
  for (std::size_t s = 0; s < count; ++s) {
    remembered.label[s] = model.label_of_surface[s];
    remembered.content[s] = model.surfaces[s].surface->content_hash();
  }
  remembered.count = static_cast<int>(count);
  remembered.version = model.version;
}

}  // namespace palpate
