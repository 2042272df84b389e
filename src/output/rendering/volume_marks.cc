#include "palpate/rendering/volume_marks.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace palpate {
namespace {

constexpr int kSamplesAcross = 2, kSamples = kSamplesAcross * kSamplesAcross;
/// Length and radius of an arrow's head, relative to the radius of its shaft.
constexpr double kHeadLength = 7, kHeadRadius = 3;
constexpr double kMarkAmbient = 0.35, kMarkDiffuse = 0.65;

struct MarkRay {
  Point<Patient> from;
  Vector<Patient> direction;  ///< Unit vector
};

MarkRay mark_ray(const VolumeCamera& camera, double column, double row) {
  const Point<Patient> at = camera.at(column, row);
  if (camera.is_parallel()) return {at, camera.into()};
  const Point<Patient> eye = camera.focus - camera.into() * camera.eye_mm;
  return {eye, (at - eye).normalized()};
}

struct MarkHit {
  double mm = std::numeric_limits<double>::infinity();
  double facing = 0;  ///< Cosine between surface normal and ray
};

/// Intersection of a ray with a mark: with the cone tangent to both spheres between the circles of tangency,
/// otherwise with the spheres.
MarkHit intersect(const MarkRay& ray, const VolumeMark& mark) {
  const Eigen::Vector3d a = (ray.from - mark.from).eigen(), b = (ray.from - mark.to).eigen(),
                        direction = ray.direction.eigen(), axis = (mark.to - mark.from).eigen();
  const double narrows = mark.from_mm - mark.to_mm, square = axis.squaredNorm() - narrows * narrows;
  const double along_ray = axis.dot(direction), along_a = axis.dot(a), a_ray = a.dot(direction);
  MarkHit hit;
  // no cone if one sphere contains the other
  if (square > 1e-12) {
    const double k2 = square - along_ray * along_ray,
                 k1 = square * a_ray - along_a * along_ray + along_ray * narrows * mark.from_mm,
                 k0 = square * a.squaredNorm() - along_a * along_a + 2 * along_a * narrows * mark.from_mm -
                      axis.squaredNorm() * mark.from_mm * mark.from_mm;
    const double within = k1 * k1 - k0 * k2;
    if (within < 0) return hit;
    if (std::abs(k2) > 1e-12 * square) {
      const double mm = (-std::sqrt(within) - k1) / k2,
                   along = along_a - mark.from_mm * narrows + mm * along_ray;
      if (along > 0 && along < square) {
        const Eigen::Vector3d normal = square * (a + mm * direction) - axis * along;
        return {mm, std::abs(normal.normalized().dot(direction))};
      }
    }
  }
  const auto ball = [&](const Eigen::Vector3d& from_middle, double radius) {
    const double midpoint = from_middle.dot(direction),
                 within = midpoint * midpoint - from_middle.squaredNorm() + radius * radius;
    if (within <= 0 || radius <= 0) return;
    const double mm = -midpoint - std::sqrt(within);
    if (mm < hit.mm) hit = {mm, std::sqrt(within) / radius};
  };
  ball(a, mark.from_mm);
  ball(b, mark.to_mm);
  return hit;
}

/// Bounding box of a mark in the picture, inclusive.
struct Reach {
  int left, right, top, bottom;
};
Reach reach_of(const VolumeCamera& camera, const VolumeMark& mark) {
  double low[2] = {1e9, 1e9}, high[2] = {-1e9, -1e9};
  const Vector<Patient> axes[2] = {camera.right, camera.down};
  const int size[2] = {camera.width_px, camera.height_px};
  const Reach anywhere{0, size[0] - 1, 0, size[1] - 1};
  for (const auto& [point, radius] : {std::pair{mark.from, mark.from_mm}, std::pair{mark.to, mark.to_mm}}) {
    const Vector<Patient> off = point - camera.focus;
    const double z = camera.eye_mm + off.dot(camera.into());
    // a mark around the eye may cover any pixel
    if (!camera.is_parallel() && z <= 2 * radius) return anywhere;
    for (int a = 0; a < 2; ++a) {
      const double midpoint = 0.5 * (size[a] - 1), x = off.dot(axes[a]);
      // parallel rays: a circle; perspective: projection of the sphere's tangents onto the plane of the focus
      double min_mm = x - radius, max_mm = x + radius;
      if (!camera.is_parallel()) {
        const double square = z * z - radius * radius, root = radius * std::sqrt(x * x + square);
        min_mm = (x * z - root) / square * camera.eye_mm;
        max_mm = (x * z + root) / square * camera.eye_mm;
      }
      if (!std::isfinite(min_mm) || !std::isfinite(max_mm)) return anywhere;
      low[a] = std::min(low[a], midpoint + min_mm / camera.mm_per_px());
      high[a] = std::max(high[a], midpoint + max_mm / camera.mm_per_px());
    }
  }
  const auto bounded = [](double value, int largest) {
    return static_cast<int>(std::clamp(value, -1.0, static_cast<double>(largest)));
  };
  return {std::max(0, bounded(std::floor(low[0] - 1), size[0])),
          std::min(size[0] - 1, bounded(high[0] + 2, size[0])),
          std::max(0, bounded(std::floor(low[1] - 1), size[1])),
          std::min(size[1] - 1, bounded(high[1] + 2, size[1]))};
}

bool is_finite(const VolumeMark& mark) {
  return mark.from.all_finite() && mark.to.all_finite() && std::isfinite(mark.from_mm) &&
         std::isfinite(mark.to_mm);
}

/// Nearest mark at a sample of a pixel.
struct MarkSample {
  float mm = std::numeric_limits<float>::infinity();
  std::uint8_t rgb[3] = {};
  float behind = 0;
};

}  // namespace

void add_path(std::vector<VolumeMark>& marks, std::span<const Point<Patient>> points, double width_px,
              const Rgb& colour, double behind, const VolumeCamera& camera) {
  const double radius = 0.5 * width_px * camera.mm_per_px(), least = 0.5 * camera.mm_per_px();
  const Point<Patient>* last = nullptr;
  for (const Point<Patient>& point : points) {
    if (!point.all_finite()) continue;
    if (last != nullptr && (point - *last).norm() < least) continue;
    if (last != nullptr) marks.push_back({*last, point, radius, radius, colour, behind});
    last = &point;
  }
}

void add_arrow(std::vector<VolumeMark>& marks, const Point<Patient>& tail,
               const Vector<Patient>& displacement, double radius_mm, const Rgb& colour) {
  const double length = displacement.norm();
  if (!(length > 0) || !std::isfinite(length)) return;
  const Point<Patient> head = tail + displacement,
                       neck = tail + displacement * std::max(0.0, 1 - kHeadLength * radius_mm / length);
  marks.push_back({tail, neck, radius_mm, radius_mm, colour, 0});
  marks.push_back({neck, head, kHeadRadius * radius_mm, 0.05 * radius_mm, colour, 0});
}

void draw_volume_marks(Image& image, std::span<const float> depth_mm, const VolumeCamera& camera,
                       std::span<const VolumeMark> marks) {
  const auto width = static_cast<std::size_t>(camera.width_px), pixels = width * camera.height_px;
  PALPATE_CHECK(depth_mm.size() == pixels && image.rgb.size() == 3 * pixels);
  std::vector<MarkSample> samples(pixels * kSamples);
  for (const VolumeMark& mark : marks) {
    if (!is_finite(mark)) continue;
    const Reach reach = reach_of(camera, mark);
    for (int row = reach.top; row <= reach.bottom; ++row)
      for (int column = reach.left; column <= reach.right; ++column)
        for (int n = 0; n < kSamples; ++n) {
          const auto part = [](int m) { return (m + 0.5) / kSamplesAcross - 0.5; };
          const MarkHit hit = intersect(
              mark_ray(camera, column + part(n % kSamplesAcross), row + part(n / kSamplesAcross)), mark);
          MarkSample& sample =
              samples[(width * static_cast<std::size_t>(row) + static_cast<std::size_t>(column)) * kSamples +
                      static_cast<std::size_t>(n)];
          if (!(hit.mm < sample.mm) || (!camera.is_parallel() && hit.mm < 0)) continue;
          const double light = kMarkAmbient + kMarkDiffuse * hit.facing;
          const auto lit = [&](std::uint8_t value) {
            return static_cast<std::uint8_t>(std::lround(value * light));
          };
          sample = {static_cast<float>(hit.mm),
                    {lit(mark.colour.r), lit(mark.colour.g), lit(mark.colour.b)},
                    static_cast<float>(mark.behind)};
        }
  }
  for (std::size_t at = 0; at < pixels; ++at) {
    const MarkSample* of_pixel = &samples[at * kSamples];
    for (std::size_t c = 0; c < 3; ++c) {
      float sum = 0;
      for (int n = 0; n < kSamples; ++n) {
        const MarkSample& sample = of_pixel[n];
        const float fraction = !std::isfinite(sample.mm) ? 0 : sample.mm <= depth_mm[at] ? 1 : sample.behind;
        sum += fraction * (static_cast<float>(sample.rgb[c]) - static_cast<float>(image.rgb[3 * at + c]));
      }
      image.rgb[3 * at + c] =
          static_cast<std::uint8_t>(std::lround(static_cast<float>(image.rgb[3 * at + c]) + sum / kSamples));
    }
  }
}

}  // namespace palpate
