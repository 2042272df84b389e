#pragma once

#include <functional>
#include <string>
#include <vector>

#include "palpate/phantoms/primitives.h"
#include "palpate/sampling/sampling.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// What is asked for a force: value and gradient at a point.
using Sampler = std::function<FieldSample(const Point<Patient>&)>;

/// 180 where `a` is zero: no gradient, no direction, as wrong as can be.
double degrees_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b);

enum WithMean : bool { kWithoutMean, kWithMean };

/// Adds path/mean, path/p99 and path/max of the values, with their limits. Nothing where there is no value.
void add_spread(std::vector<Figure>& figures, const std::string& path, const char* unit,
                std::vector<double> values, WithMean with_mean = kWithMean);

inline constexpr double kChoppinessStep_mm = 0.01;

/// A path at constant distance from a surface, `count` steps of `step_mm`, that goes straight ahead on it (on
/// a sphere a great circle). The start's distance is kept.
/// @param direction  where to go, of any length; its part along the normal does not count. Not along the
/// normal.
std::vector<Point<Patient>> constant_depth_path(const Shape& shape, const Point<Patient>& start,
                                                const Vector<Patient>& direction, double step_mm, int count);

/// How far the force moves from each point of a path to the next, in percent of full force: the vector value
/// * n, n = -gradient / |gradient|, so that a turn counts as much as a change of magnitude.
std::vector<double> force_changes_percent(const Sampler& sample, const std::vector<Point<Patient>>& path);

/// Whether the window of the Gaussian sphere stays where it is between two points; halves go up.
bool same_nearest_voxel(const Point<Voxel>& a, const Point<Voxel>& b);

}  // namespace palpate
