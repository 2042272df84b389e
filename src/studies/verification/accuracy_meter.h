#pragma once

#include <functional>
#include <string>
#include <vector>

#include "palpate/phantoms/primitives.h"
#include "palpate/sampling/sampling.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// Field of a force method: value and gradient at a point.
using Sampler = std::function<FieldSample(const Point<Patient>&)>;

/// Angle between two directions; 180 if `a` is zero, because without a gradient there is no direction.
double degrees_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b);

enum WithMean : bool { kWithoutMean, kWithMean };

/// Appends path/mean, path/p99 and path/max of the values, with their limits. Appends nothing if there are no
/// values.
void add_spread(std::vector<Figure>& figures, const std::string& path, const char* unit,
                std::vector<double> values, WithMean with_mean = kWithMean);

inline constexpr double kChoppinessStep_mm = 0.01;

/// Path at constant distance from a surface, `count` steps of `step_mm`, without turning on the surface (a
/// great circle on a sphere). The distance is that of the start.
/// @param direction  initial direction, of any length; its component along the normal is ignored. Not
///                   parallel to the normal
std::vector<Point<Patient>> constant_depth_path(const Shape& shape, const Point<Patient>& start,
                                                const Vector<Patient>& direction, double step_mm, int count);

/// Change of the force between successive points of a path, in percent of full force. The force is the vector
/// value * n, n = -gradient / |gradient|, so that changes of direction count as much as changes of magnitude.
std::vector<double> force_changes_percent(const Sampler& sample, const std::vector<Point<Patient>>& path);

/// Whether the window of the Gaussian sphere is centred on the same voxel for both points; halves are rounded
/// up.
bool same_nearest_voxel(const Point<Voxel>& a, const Point<Voxel>& b);

}  // namespace palpate
