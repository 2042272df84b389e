#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "palpate/sampling/sampling.h"

/// Implementations of value and gradient at a point, as compared by sampling_bench.
namespace palpate::bench {

using Points = std::span<const Point<Patient>>;
using Samples = std::span<FieldSample>;

/// Which part of a sample has to agree with the others.
enum class Compared { kAll, kValue, kNothing };

struct Entrant {
  std::string name;
  /// All points, independent of each other.
  std::function<void(Points, Samples)> throughput;
  /// Every point's position depends on the previous sample; empty for implementations that process many
  /// points at once.
  std::function<void(Points, Samples)> latency;
  Compared compared = Compared::kAll;
};

/// Makes an entrant of a function `sample`. The two loops are compiled at the call site, so that it can be
/// inlined.
template <class Sample>
Entrant entrant(std::string name, const Sample& sample, Compared compared = Compared::kAll) {
  Entrant result;
  result.name = std::move(name);
  result.compared = compared;
  result.throughput = [sample](Points points, Samples samples) {
    for (std::size_t n = 0; n < points.size(); ++n) samples[n] = sample(points[n]);
  };
  result.latency = [sample](Points points, Samples samples) {
    // always adds zero, but the processor cannot know that
    double nothing = 0;
    for (std::size_t n = 0; n < points.size(); ++n) {
      const Point<Patient>& p = points[n];
      samples[n] = sample(Point<Patient>(p.x() + nothing, p.y(), p.z()));
      nothing = 0 * (samples[n].value + samples[n].gradient.x());
    }
  };
  return result;
}

/// The field that all of them sample, from the same bytes.
struct SampledWork {
  Volume<std::uint8_t> bytes;  ///< In units of 1/255
  Transform<Voxel, Patient> X_VoxelPatient;
  Eigen::Matrix3d gradient_map;
};

/// Straightforward implementations; the first is the reference.
std::vector<Entrant> plain_entrants(const std::shared_ptr<const SampledWork>& work);
/// Lower bound: only finds the cell and loads its twelve rows.
Entrant loads_only(const std::shared_ptr<const SampledWork>& work);
/// Splines with 16-bit coefficients; the first is the reference, the plain sum of 64 terms.
std::vector<Entrant> plain_splines(const SplineField& field);

std::vector<Entrant> itk_entrants(const std::shared_ptr<const SampledWork>& work);
Entrant itk_spline(const std::shared_ptr<const SampledWork>& work);
std::vector<Entrant> vtk_entrants(const std::shared_ptr<const SampledWork>& work);
std::vector<Entrant> vdb_entrants(const std::shared_ptr<const SampledWork>& work);

}  // namespace palpate::bench
