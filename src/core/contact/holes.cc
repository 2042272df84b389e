#include "palpate/contact/holes.h"

#include <algorithm>

#include "palpate/base/hash.h"
#include "palpate/contact/contact_settings.h"

namespace palpate {
namespace {

// lateral distance of a point from the hole's axis
double lateral_mm(const Hole& hole, const Vector<Patient>& from_entry) {
  return (from_entry - hole.inward * from_entry.dot(hole.inward)).norm();
}

}  // namespace

bool Hole::fits(const Point<Patient>& centre, double part_radius_mm) const {
  const Vector<Patient> from_entry = centre - at;
  const double along_mm = from_entry.dot(inward), play_mm = kProxySettings.hole_play_mm;
  // a part may be anywhere in the hole, with a tolerance for one in contact with the rim beside it
  const double room_mm = radius_mm - part_radius_mm + play_mm;
  return part_radius_mm <= radius_mm + kProxySettings.skin_mm && along_mm >= -play_mm &&
         along_mm <= length_mm + play_mm && lateral_mm(*this, from_entry) <= room_mm;
}

void Holes::add(const Hole& hole) {
  if (count_ < kCapacity) {
    hole_[count_++] = hole;
    return;
  }
  hole_[oldest_] = hole;
  oldest_ = (oldest_ + 1) % kCapacity;
}

void Holes::extend(int structure, const Point<Patient>& centre) {
  for (std::size_t n = 0; n < count_; ++n) {
    Hole& hole = hole_[n];
    const Vector<Patient> from_entry = centre - hole.at;
    if (hole.structure != structure ||
        lateral_mm(hole, from_entry) > hole.radius_mm + kProxySettings.hole_play_mm)
      continue;
    hole.length_mm = std::max(hole.length_mm, from_entry.dot(hole.inward));
  }
}

void Holes::transfer(std::span<const SurfaceCorrespondence> correspondences) {
  const Holes old = *this;
  *this = {};
  // in order of creation
  for (std::size_t n = 0; n < old.count_; ++n) {
    Hole hole = old.hole_[(old.oldest_ + n) % old.count_];
    const auto now =
        std::find_if(correspondences.begin(), correspondences.end(),
                     [&](const SurfaceCorrespondence& one) { return one.index == hole.structure; });
    if (now == correspondences.end()) continue;
    hole.structure = static_cast<int>(now - correspondences.begin());
    add(hole);
  }
}

void Holes::hash_into(std::uint64_t& hash) const {
  hash_word(hash, count_ << 8 | oldest_);
  for (const Hole& hole : all()) {
    hash_word(hash, static_cast<std::uint64_t>(hole.structure));
    for (int axis = 0; axis < 3; ++axis) {
      hash_double(hash, hole.at[axis]);
      hash_double(hash, hole.inward[axis]);
    }
    hash_double(hash, hole.length_mm);
    hash_double(hash, hole.radius_mm);
  }
}

}  // namespace palpate
