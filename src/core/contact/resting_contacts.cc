#include <algorithm>

#include "palpate/contact/proxy.h"

namespace palpate {

std::span<const RestingContacts::Constraint> RestingContacts::find(const Point<Patient>& position,
                                                                   const SurfaceSet& punctured,
                                                                   std::span<const ToolPart> parts) const {
  bool same = count_ > 0 && position == position_ && parts.size() == spheres_ && punctured == punctured_;
  for (std::size_t k = 0; same && k < parts.size(); ++k)
    same = parts[k].offset_mm == sphere_[k].offset_mm && parts[k].radius_mm == sphere_[k].radius_mm &&
           parts[k].axis_mm == Vector<Patient>();
  return {constraint_.data(), same ? count_ : 0};
}

void RestingContacts::store(const Point<Patient>& position, const SurfaceSet& punctured,
                            std::span<const ToolPart> parts, std::span<const Constraint> constraints) {
  PALPATE_CHECK(constraints.size() <= kMaxConstraints && parts.size() <= kMaxToolParts);
  std::copy(constraints.begin(), constraints.end(), constraint_.begin());
  count_ = constraints.size();
  spheres_ = parts.size();
  for (std::size_t k = 0; k < spheres_; ++k) sphere_[k] = {parts[k].offset_mm, parts[k].radius_mm};
  position_ = position;
  punctured_ = punctured;
}

}  // namespace palpate
