#include "contact/near_surfaces.h"

#include <algorithm>

namespace palpate {

namespace {

// axis-aligned bounds of the centres of a part's spheres, in the patient frame
struct AxisBox {
  Eigen::Array3d low, high;

  AxisBox(const Point<Patient>& at, const ToolSphere& shape) {
    const Eigen::Array3d begin = (at + shape.offset_mm).eigen().array();
    const Eigen::Array3d end = begin + shape.along_mm.eigen().array();
    low = begin.min(end);
    high = begin.max(end);
  }
};

// whether the surface's bounding box excludes that any sphere of the part comes within a distance
bool is_known_beyond(const Surface& surface, const ToolSphere& shape, const Point<Patient>& at,
                     double within_mm) {
  if (shape.along_mm == Vector<Patient>()) return surface.is_beyond(at + shape.offset_mm, within_mm);
  const AxisBox box(at, shape);
  return surface.is_beyond(box.low, box.high, within_mm);
}

}  // namespace

void PairSet::gather(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres, int layer,
                     const SurfaceSet& punctured, const Point<Patient>& at, double reach_mm) {
  count_ = 0;
  left_out_mm_ = std::numeric_limits<double>::infinity();
  AxisBox tool(at, spheres[0]);
  double widest_mm = 0;
  for (const ToolSphere& sphere : spheres) {
    const AxisBox box(at, sphere);
    tool.low = tool.low.min(box.low);
    tool.high = tool.high.max(box.high);
    widest_mm = std::max({widest_mm, sphere.radius_mm, sphere.radius_at_mm(1)});
  }
  for (std::size_t s = 0; s < surfaces.size(); ++s) {
    if (!is_there(surfaces, layer, punctured, s)) continue;
    const Surface& surface = *surfaces[s].surface;
    // early-out for the common case: the path does not reach the surface's bounding box
    const bool known_free = surface.outside_mm() > widest_mm + kProxyFeel.skin_mm;
    if (known_free && surface.is_beyond(tool.low, tool.high, reach_mm)) continue;
    for (std::size_t k = 0; k < spheres.size(); ++k) {
      const ToolSphere& sphere = spheres[k];
      if (known_free && is_known_beyond(surface, sphere, at, reach_mm)) continue;
      const ContactPair near{&surface, static_cast<int>(s), static_cast<int>(k), sphere, row_steps(sphere)};
      const double far_mm = reach_mm * surface.steepest();
      if (near.steps == 0 && surface.at_least_mm(at + sphere.offset_mm) > far_mm + sphere.radius_mm) continue;
      const Known known = look(near, at, far_mm, near.steps / 2);
      if (known.clearance_mm <= far_mm) insert(near, known.clearance_mm / surface.steepest(), known);
    }
  }
  reach_mm_ = std::max(0.0, std::min(reach_mm, left_out_mm_));
}

bool is_free(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres, int layer,
             const SurfaceSet& punctured, const SurfaceSet& but, const Point<Patient>& at) {
  int looks = 0;
  for (std::size_t s = 0; s < surfaces.size(); ++s) {
    if (but[s] || !is_there(surfaces, layer, punctured, s)) continue;
    const Surface& surface = *surfaces[s].surface;
    for (std::size_t k = 0; k < spheres.size(); ++k) {
      const ToolSphere& sphere = spheres[k];
      const ContactPair near{&surface, static_cast<int>(s), static_cast<int>(k), sphere, row_steps(sphere)};
      const double min_mm = sphere.radius_mm - kProxyFeel.outside_mm;
      if (near.steps == 0 && surface.at_least_mm(at + sphere.offset_mm) >= min_mm) continue;
      if (near.clearance(at, -kProxyFeel.outside_mm, near.steps / 2, looks).mm < -kProxyFeel.outside_mm)
        return false;
    }
  }
  return true;
}

double PairSet::steepest() const {
  double steepest = 1;
  for (std::size_t n = 0; n < count_; ++n) steepest = std::max(steepest, near_[n].surface->steepest());
  return steepest;
}

PairSet::Known PairSet::look(const ContactPair& near, const Point<Patient>& proxy, double enough_mm,
                             int begin) {
  const ContactPair::Clearance clearance = near.clearance(proxy, enough_mm, begin, looks_);
  return {proxy + near.shape.offset_mm, clearance.mm,
          near.steps == 0 ? std::numeric_limits<double>::infinity() : enough_mm, clearance.step};
}

double PairSet::clearance(std::size_t n, const Point<Patient>& proxy, double enough_mm) {
  Known& known = known_[n];
  const ContactPair& near = near_[n];
  const Point<Patient> centre = proxy + near.shape.offset_mm;
  const double moved_mm = (centre - known.centre).norm();
  const double at_least_mm = known.clearance_mm - moved_mm * near.surface->steepest();
  if (moved_mm == 0 && known.clearance_mm <= known.enough_mm) return known.clearance_mm;
  if (at_least_mm > enough_mm) return at_least_mm;
  known = look(near, proxy, enough_mm, known.step);
  return known.clearance_mm;
}

double PairSet::middle_of_touching(std::size_t n, const Point<Patient>& proxy, int step) {
  const ContactPair& near = near_[n];
  if (near.steps == 0) return 0;
  return palpate::middle_of_touching(*near.surface, proxy + near.shape.offset_mm, near.shape, near.steps,
                                     step, kProxyFeel.beside_mm, looks_);
}

void PairSet::turn(std::span<const ToolSphere> spheres) {
  for (std::size_t n = 0; n < count_; ++n) {
    const ToolSphere& turned = spheres[static_cast<std::size_t>(near_[n].sphere)];
    if (near_[n].steps > 0) {
      // bound for the displacement of the last sphere beyond that of the first
      known_[n].clearance_mm -=
          (turned.along_mm - near_[n].shape.along_mm).norm() * near_[n].surface->steepest();
      known_[n].enough_mm = -std::numeric_limits<double>::infinity();
    }
    near_[n].shape = turned;
  }
}

// insertion sort by clearance, so that the nearest pairs are kept
void PairSet::insert(const ContactPair& near, double clearance_mm, const Known& known) {
  if (count_ == kMaxNear)
    left_out_mm_ = std::min(left_out_mm_, std::max(clearance_mm, clearances_mm_[kMaxNear - 1]));
  std::size_t place = count_;
  while (place > 0 && clearances_mm_[place - 1] > clearance_mm) --place;
  if (place == kMaxNear) return;
  count_ = std::min(count_ + 1, kMaxNear);
  for (std::size_t n = count_ - 1; n > place; --n) {
    near_.make(n, near_[n - 1]);
    known_.make(n, known_[n - 1]);
    clearances_mm_.make(n, clearances_mm_[n - 1]);
  }
  near_.make(place, near);
  known_.make(place, known);
  clearances_mm_.make(place, clearance_mm);
}

bool ContactConstraints::add(const ContactPair& near, int step, const Point<Patient>& at,
                             double clearance_mm) {
  const Vector<Patient> normal = near.surface->outward(at + near.offset_mm(step));
  if (normal == Vector<Patient>()) return false;
  const HalfSpace wall{normal, normal.eigen().dot(at.eigen()) - clearance_mm};
  const std::size_t place = full() ? place_of_weaker(wall) : count_++;
  if (place == kMaxHalfSpaces) return false;
  put(place, near, step, wall);
  return true;
}

void ContactConstraints::put(std::size_t place, const ContactPair& near, int step, const HalfSpace& wall) {
  half_spaces_.make(place, wall);
  near_.make(place, &near);
  step_.make(place, step);
}

// index of a parallel half-space that is less restrictive, or kMaxHalfSpaces
std::size_t ContactConstraints::place_of_weaker(const HalfSpace& wall) const {
  std::size_t n = 0;
  while (n < kMaxHalfSpaces && !(half_spaces_[n].normal.dot(wall.normal) > kProxyFeel.parallel &&
                                 half_spaces_[n].offset < wall.offset))
    ++n;
  return n;
}

bool project_out(PairSet& near, int max_steps, double step_mm, Point<Patient>& proxy) {
  ContactConstraints walls;
  Point<Patient> outside = proxy;
  for (int n = 0; n <= max_steps; ++n) {
    walls.clear();
    double deepest_mm = 0;
    for (std::size_t i = 0; i < near.count(); ++i) {
      const double clearance_mm = near.clearance(i, outside, 0);
      deepest_mm = std::min(deepest_mm, clearance_mm);
      if (clearance_mm < 0) walls.add(near[i], near.step(i), outside, clearance_mm);
    }
    if (deepest_mm > -kProxyFeel.outside_mm) {
      proxy = outside;
      return true;
    }
    const auto nearest = closest_point(outside, walls.half_spaces());
    if (!nearest) return false;
    const Vector<Patient> way = nearest->point - outside;
    outside += way * std::min(1.0, step_mm / way.norm());
  }
  return false;
}

}  // namespace palpate
