#include "contact/near_surfaces.h"

#include <algorithm>

namespace palpate {

namespace {

// axis-aligned bounds of the centres of a part's spheres, in the patient frame
struct AxisBounds {
  Eigen::Array3d low, high;

  AxisBounds(const Point<Patient>& at, const ToolPart& shape) {
    const Eigen::Array3d begin = (at + shape.offset_mm).eigen().array();
    const Eigen::Array3d end = begin + shape.axis_mm.eigen().array();
    low = begin.min(end);
    high = begin.max(end);
  }
};

// whether the surface's bounding box excludes that any sphere of the part comes within a distance
bool is_certainly_beyond(const Surface& surface, const ToolPart& shape, const Point<Patient>& at,
                         double distance_mm) {
  if (shape.axis_mm == Vector<Patient>()) return surface.is_farther_than(at + shape.offset_mm, distance_mm);
  const AxisBounds box(at, shape);
  return surface.is_farther_than(box.low, box.high, distance_mm);
}

}  // namespace

void PairSet::gather(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts, int layer,
                     const SurfaceSet& punctured, const Point<Patient>& at, double reach_mm) {
  count_ = 0;
  min_rejected_mm_ = std::numeric_limits<double>::infinity();
  AxisBounds tool(at, parts[0]);
  double widest_mm = 0;
  for (const ToolPart& part : parts) {
    const AxisBounds box(at, part);
    tool.low = tool.low.min(box.low);
    tool.high = tool.high.max(box.high);
    widest_mm = std::max({widest_mm, part.radius_mm, part.radius_at_mm(1)});
  }
  for (std::size_t s = 0; s < surfaces.size(); ++s) {
    if (!can_touch(surfaces, layer, punctured, s)) continue;
    const Surface& surface = *surfaces[s].surface;
    // early-out for the common case: the path does not reach the surface's bounding box
    const bool known_free = surface.outside_mm() > widest_mm + kProxySettings.skin_mm;
    if (known_free && surface.is_farther_than(tool.low, tool.high, reach_mm)) continue;
    for (std::size_t k = 0; k < parts.size(); ++k) {
      const ToolPart& part = parts[k];
      if (known_free && is_certainly_beyond(surface, part, at, reach_mm)) continue;
      const ContactPair pair{&surface, static_cast<int>(s), static_cast<int>(k), part, row_steps(part)};
      const double far_mm = reach_mm * surface.max_gradient();
      if (pair.steps == 0 && surface.lower_bound_mm(at + part.offset_mm) > far_mm + part.radius_mm) continue;
      const Evaluation evaluation = evaluate(pair, at, far_mm, pair.steps / 2);
      if (evaluation.clearance_mm <= far_mm)
        insert(pair, evaluation.clearance_mm / surface.max_gradient(), evaluation);
    }
  }
  reach_mm_ = std::max(0.0, std::min(reach_mm, min_rejected_mm_));
}

bool is_free(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts, int layer,
             const SurfaceSet& punctured, const SurfaceSet& ignored, const Point<Patient>& at) {
  int queries = 0;
  for (std::size_t s = 0; s < surfaces.size(); ++s) {
    if (ignored[s] || !can_touch(surfaces, layer, punctured, s)) continue;
    const Surface& surface = *surfaces[s].surface;
    for (std::size_t k = 0; k < parts.size(); ++k) {
      const ToolPart& part = parts[k];
      const ContactPair pair{&surface, static_cast<int>(s), static_cast<int>(k), part, row_steps(part)};
      const double min_mm = part.radius_mm - kProxySettings.outside_mm;
      if (pair.steps == 0 && surface.lower_bound_mm(at + part.offset_mm) >= min_mm) continue;
      if (pair.clearance(at, -kProxySettings.outside_mm, pair.steps / 2, queries).mm <
          -kProxySettings.outside_mm)
        return false;
    }
  }
  return true;
}

double PairSet::max_gradient() const {
  double max_gradient = 1;
  for (std::size_t n = 0; n < count_; ++n)
    max_gradient = std::max(max_gradient, pairs_[n].surface->max_gradient());
  return max_gradient;
}

PairSet::Evaluation PairSet::evaluate(const ContactPair& pair, const Point<Patient>& proxy, double cutoff_mm,
                                      int begin) {
  const ContactPair::Clearance clearance = pair.clearance(proxy, cutoff_mm, begin, queries_);
  return {proxy + pair.shape.offset_mm, clearance.mm,
          pair.steps == 0 ? std::numeric_limits<double>::infinity() : cutoff_mm, clearance.step};
}

double PairSet::clearance(std::size_t n, const Point<Patient>& proxy, double cutoff_mm) {
  Evaluation& evaluation = evaluations_[n];
  const ContactPair& pair = pairs_[n];
  const Point<Patient> centre = proxy + pair.shape.offset_mm;
  const double moved_mm = (centre - evaluation.centre).norm();
  const double lower_bound_mm = evaluation.clearance_mm - moved_mm * pair.surface->max_gradient();
  if (moved_mm == 0 && evaluation.clearance_mm <= evaluation.cutoff_mm) return evaluation.clearance_mm;
  if (lower_bound_mm > cutoff_mm) return lower_bound_mm;
  evaluation = evaluate(pair, proxy, cutoff_mm, evaluation.step);
  return evaluation.clearance_mm;
}

double PairSet::middle_of_touching(std::size_t n, const Point<Patient>& proxy, int step) {
  const ContactPair& pair = pairs_[n];
  if (pair.steps == 0) return 0;
  return palpate::middle_of_touching(*pair.surface, proxy + pair.shape.offset_mm, pair.shape, pair.steps,
                                     step, kProxySettings.load_sharing_mm, queries_);
}

void PairSet::turn(std::span<const ToolPart> parts) {
  for (std::size_t n = 0; n < count_; ++n) {
    const ToolPart& turned = parts[static_cast<std::size_t>(pairs_[n].part)];
    if (pairs_[n].steps > 0) {
      // bound for the displacement of the last sphere beyond that of the first
      evaluations_[n].clearance_mm -=
          (turned.axis_mm - pairs_[n].shape.axis_mm).norm() * pairs_[n].surface->max_gradient();
      evaluations_[n].cutoff_mm = -std::numeric_limits<double>::infinity();
    }
    pairs_[n].shape = turned;
  }
}

// insertion sort by clearance, so that the nearest pairs are kept
void PairSet::insert(const ContactPair& pair, double clearance_mm, const Evaluation& evaluation) {
  if (count_ == kMaxPairs)
    min_rejected_mm_ = std::min(min_rejected_mm_, std::max(clearance_mm, clearances_mm_[kMaxPairs - 1]));
  std::size_t index = count_;
  while (index > 0 && clearances_mm_[index - 1] > clearance_mm) --index;
  if (index == kMaxPairs) return;
  count_ = std::min(count_ + 1, kMaxPairs);
  for (std::size_t n = count_ - 1; n > index; --n) {
    pairs_.make(n, pairs_[n - 1]);
    evaluations_.make(n, evaluations_[n - 1]);
    clearances_mm_.make(n, clearances_mm_[n - 1]);
  }
  pairs_.make(index, pair);
  evaluations_.make(index, evaluation);
  clearances_mm_.make(index, clearance_mm);
}

bool ContactConstraints::add(const ContactPair& pair, int step, const Point<Patient>& at,
                             double clearance_mm) {
  const Vector<Patient> normal = pair.surface->outward(at + pair.offset_mm(step));
  if (normal == Vector<Patient>()) return false;
  const HalfSpace plane{normal, normal.eigen().dot(at.eigen()) - clearance_mm};
  const std::size_t index = full() ? index_of_weaker(plane) : count_++;
  if (index == kMaxHalfSpaces) return false;
  put(index, pair, step, plane);
  return true;
}

void ContactConstraints::put(std::size_t index, const ContactPair& pair, int step, const HalfSpace& plane) {
  half_spaces_.make(index, plane);
  pairs_.make(index, &pair);
  step_.make(index, step);
}

// index of a parallel half-space that is less restrictive, or kMaxHalfSpaces
std::size_t ContactConstraints::index_of_weaker(const HalfSpace& plane) const {
  std::size_t n = 0;
  while (n < kMaxHalfSpaces &&
         !(half_spaces_[n].normal.dot(plane.normal) > kProxySettings.min_parallel_cosine &&
           half_spaces_[n].offset < plane.offset))
    ++n;
  return n;
}

bool project_out(PairSet& pairs, int max_steps, double step_mm, Point<Patient>& proxy) {
  ContactConstraints constraints;
  Point<Patient> outside = proxy;
  for (int n = 0; n <= max_steps; ++n) {
    constraints.clear();
    double deepest_mm = 0;
    for (std::size_t i = 0; i < pairs.count(); ++i) {
      const double clearance_mm = pairs.clearance(i, outside, 0);
      deepest_mm = std::min(deepest_mm, clearance_mm);
      if (clearance_mm < 0) constraints.add(pairs[i], pairs.step(i), outside, clearance_mm);
    }
    if (deepest_mm > -kProxySettings.outside_mm) {
      proxy = outside;
      return true;
    }
    const auto nearest = closest_point(outside, constraints.half_spaces());
    if (!nearest) return false;
    const Vector<Patient> displacement = nearest->point - outside;
    outside += displacement * std::min(1.0, step_mm / displacement.norm());
  }
  return false;
}

}  // namespace palpate
