#include "contact/penetration_path.h"

#include <algorithm>
#include <functional>

namespace palpate {

void PenetrationPath::add_owner(int structure, double fraction) {
  const std::size_t first = layer_[layers_ - 1].first_owner;
  const std::span own(owner_.data() + first, owners_ - first);
  const auto same = std::find_if(own.begin(), own.end(),
                                 [&](const OwnerFraction& one) { return one.structure == structure; });
  if (same != own.end())
    same->fraction += fraction;
  else if (owners_ < owner_.size())
    owner_.make(owners_++, structure, fraction);
}

void PenetrationPath::report(ProxyResult& result) const {
  const Vector<Patient> along = force_N_.normalized();
  UninitialisedArray<PathSegment, kMaxOwners> segment;
  std::size_t segments = 0;
  double stiffness = 0, all_N = 0;
  for (std::size_t m = 0; m < layers_; ++m) {
    const Layer& layer = layer_[m];
    const bool innermost = m + 1 == layers_;
    const Vector<Patient> beneath_mm = innermost ? Vector<Patient>() : layer_[m + 1].stretched_mm;
    const std::size_t end = innermost ? owners_ : layer_[m + 1].first_owner;
    stiffness += layer.stiffness;
    // an inner layer touched from the side may have a longer spring than the layer around it
    const double depth_mm = std::max(0.0, layer.stretched_mm.norm() - beneath_mm.norm());
    const double force_N = std::max(0.0, stiffness * (layer.stretched_mm - beneath_mm).dot(along));
    all_N += force_N;
    for (std::size_t n = layer.first_owner; n < end; ++n) {
      std::size_t at = 0;
      while (at < segments && segment[at].structure != owner_[n].structure) ++at;
      if (at == segments) segment.make(segments++).structure = owner_[n].structure;
      segment[at].depth_mm += depth_mm * owner_[n].fraction;
      segment[at].fraction += force_N * owner_[n].fraction;
    }
  }
  if (!(all_N > 0)) return;
  report_largest({segment.data(), segments}, all_N, result);
}

void PenetrationPath::report_largest(std::span<PathSegment> segments, double all_N, ProxyResult& result) {
  std::array<double, kMaxOwners> fractions;
  for (std::size_t n = 0; n < segments.size(); ++n) fractions[n] = segments[n].fraction /= all_N;
  double smallest = kContactSettings.min_fraction;
  if (segments.size() > kMaxPathSegments) {
    std::nth_element(fractions.begin(), fractions.begin() + kMaxPathSegments - 1,
                     fractions.begin() + static_cast<std::ptrdiff_t>(segments.size()), std::greater<>());
    smallest = std::max(smallest, fractions[kMaxPathSegments - 1]);
  }
  for (const PathSegment& one : segments)
    if (one.fraction >= smallest && result.path_segments < static_cast<int>(kMaxPathSegments))
      result.path[static_cast<std::size_t>(result.path_segments++)] = one;
}

}  // namespace palpate
