#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "palpate/sampling/sampling.h"

/// Ways of getting a value and a gradient at a point, as sampling_bench compares them.
namespace palpate::bench {

using Points = std::span<const Point<Patient>>;
using Samples = std::span<FieldSample>;

/// What of a sample must be the others'.
enum class Compared { kAll, kValue, kNothing };

struct Entrant {
  std::string name;
  /// All points, none waiting for another.
  std::function<void(Points, Samples)> throughput;
  /// Every point's position depends on the sample before it; empty for whoever takes many points at once.
  std::function<void(Points, Samples)> latency;
  Compared compared = Compared::kAll;
};

/// `sample` is called in two loops, compiled where this is called so that it may be inlined.
template <class Sample>
Entrant entrant(std::string name, const Sample& sample, Compared compared = Compared::kAll) {
  Entrant result;
  result.name = std::move(name);
  result.compared = compared;
  result.throughput = [sample](Points points, Samples samples) {
    for (std::size_t n = 0; n < points.size(); ++n) samples[n] = sample(points[n]);
  };
  result.latency = [sample](Points points, Samples samples) {
    // nothing is added, but the processor cannot know
    double nothing = 0;
    for (std::size_t n = 0; n < points.size(); ++n) {
      const Point<Patient>& p = points[n];
      samples[n] = sample(Point<Patient>(p.x() + nothing, p.y(), p.z()));
      nothing = 0 * (samples[n].value + samples[n].gradient.x());
    }
  };
  return result;
}

/// The field that all sample, from the same bytes.
struct SampledWork {
  Volume<std::uint8_t> bytes;  ///< fractions of 255
  Transform<Voxel, Patient> X_VoxelPatient;
  Eigen::Matrix3d gradient_map;
};

/// Plain code, as one would write it first; the reference comes first.
std::vector<Entrant> plain_entrants(const std::shared_ptr<const SampledWork>& work);
/// Only what no way of sampling can do without: the cell, and the loads of its twelve rows.
Entrant loads_alone(const std::shared_ptr<const SampledWork>& work);
/// Of a spline with 16-bit coefficients; the reference, the plain sum of 64 terms, comes first.
std::vector<Entrant> plain_splines(const SplineField& field);

std::vector<Entrant> itk_entrants(const std::shared_ptr<const SampledWork>& work);
Entrant itk_spline(const std::shared_ptr<const SampledWork>& work);
std::vector<Entrant> vtk_entrants(const std::shared_ptr<const SampledWork>& work);
std::vector<Entrant> vdb_entrants(const std::shared_ptr<const SampledWork>& work);

}  // namespace palpate::bench
