#include "palpate/contact/proxy.h"

namespace palpate {

OwnerFractions owners_at(std::span<const ContactSurface> surfaces, int index, const Point<Patient>& at) {
  const ContactSurface& surface = surfaces[static_cast<std::size_t>(index)];
  if (surface.owners == nullptr) return OwnerFractions(surface.structure < 0 ? index : surface.structure);
  if (surface.original_surface == nullptr) return surface.owners->at(at);
  // labels below the surface differ only from a depth of half a voxel
  const double beneath_mm = 0.5 * surface.original_labels->geometry().min_spacing_mm();
  return surface.original_surface->distance_mm(at) < -beneath_mm
             ? surface.owners->within(*surface.original_labels, at)
             : surface.owners->at(at);
}

OwnerFractions OwnerCache::at(std::span<const ContactSurface> surfaces, int index,
                              const Point<Patient>& position) {
  const ContactSurface& surface = surfaces[static_cast<std::size_t>(index)];
  if (surface.owners == nullptr) return owners_at(surfaces, index, position);
  const bool cut = surface.original_surface != nullptr;
  for (const Entry& entry : entries_)
    if (entry.owners == surface.owners->id() && entry.surface == index && entry.cut == cut &&
        entry.position == position)
      return entry.fractions;
  Entry& entry = entries_[next_];
  next_ = (next_ + 1) % entries_.size();
  entry = {surface.owners->id(), index, cut, position, owners_at(surfaces, index, position)};
  return entry.fractions;
}

}  // namespace palpate
