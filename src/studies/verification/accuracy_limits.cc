#include <algorithm>
#include <array>
#include <span>
#include <string>
#include <string_view>

#include "verification/accuracy.h"
#include "verification/accuracy_cases.h"

namespace palpate {
namespace {

struct Limit {
  std::string_view path;
  double mean, p99;
};

// Measured values at the time the method was implemented, plus 10 %. The suite is deterministic, so a larger
// value indicates a change of the method.
constexpr std::array kLimits = std::to_array<Limit>({
    {"trilinear/sphere-20mm/0.28x0.28x1.0/direction", 0.713, 4.543},
    {"trilinear/sphere-20mm/0.28x0.28x1.0/magnitude", 0.281, 2.890},
    {"trilinear/sphere-20mm/0.28x0.28x1.0/sigma-1.0/direction", 1.482, 10.716},
    {"trilinear/sphere-20mm/0.28x0.28x1.0/sigma-1.0/magnitude", 0.697, 5.622},
    {"trilinear/sphere-20mm/0.625x0.625x0.9/direction", 0.885, 4.952},
    {"trilinear/sphere-20mm/0.625x0.625x0.9/magnitude", 0.477, 2.203},
    {"trilinear/sphere-20mm/0.625x0.625x0.9/sigma-1.0/direction", 1.935, 9.039},
    {"trilinear/sphere-20mm/0.625x0.625x0.9/sigma-1.0/magnitude", 1.132, 5.476},
    {"trilinear/sphere-20mm/0.3x0.3x0.3/direction", 0.159, 0.733},
    {"trilinear/sphere-20mm/0.3x0.3x0.3/magnitude", 0.090, 0.536},
    {"trilinear/sphere-20mm/0.3x0.3x0.3/sigma-1.0/direction", 0.329, 1.625},
    {"trilinear/sphere-20mm/0.3x0.3x0.3/sigma-1.0/magnitude", 0.201, 1.165},
    {"trilinear/cylinder-10mm/0.28x0.28x1.0/direction", 0.380, 0.966},
    {"trilinear/cylinder-10mm/0.28x0.28x1.0/magnitude", 0.168, 0.572},
    {"trilinear/cylinder-10mm/0.28x0.28x1.0/sigma-1.0/direction", 0.763, 1.934},
    {"trilinear/cylinder-10mm/0.28x0.28x1.0/sigma-1.0/magnitude", 0.418, 1.521},
    {"trilinear/cylinder-10mm/0.625x0.625x0.9/direction", 0.744, 2.087},
    {"trilinear/cylinder-10mm/0.625x0.625x0.9/magnitude", 0.427, 1.427},
    {"trilinear/cylinder-10mm/0.625x0.625x0.9/sigma-1.0/direction", 1.550, 4.273},
    {"trilinear/cylinder-10mm/0.625x0.625x0.9/sigma-1.0/magnitude", 1.032, 3.647},
    {"trilinear/cylinder-10mm/0.3x0.3x0.3/direction", 0.138, 0.464},
    {"trilinear/cylinder-10mm/0.3x0.3x0.3/magnitude", 0.081, 0.260},
    {"trilinear/cylinder-10mm/0.3x0.3x0.3/sigma-1.0/direction", 0.300, 1.049},
    {"trilinear/cylinder-10mm/0.3x0.3x0.3/sigma-1.0/magnitude", 0.189, 0.727},
    {"trilinear/tilted-plane/0.28x0.28x1.0/direction", 1.205, 1.628},
    {"trilinear/tilted-plane/0.28x0.28x1.0/magnitude", 0.278, 0.784},
    {"trilinear/tilted-plane/0.28x0.28x1.0/sigma-1.0/direction", 2.285, 3.367},
    {"trilinear/tilted-plane/0.28x0.28x1.0/sigma-1.0/magnitude", 0.802, 2.078},
    {"trilinear/tilted-plane/0.625x0.625x0.9/direction", 0.862, 1.217},
    {"trilinear/tilted-plane/0.625x0.625x0.9/magnitude", 0.281, 0.777},
    {"trilinear/tilted-plane/0.625x0.625x0.9/sigma-1.0/direction", 1.709, 2.741},
    {"trilinear/tilted-plane/0.625x0.625x0.9/sigma-1.0/magnitude", 0.817, 2.093},
    {"trilinear/tilted-plane/0.3x0.3x0.3/direction", 0.083, 0.093},
    {"trilinear/tilted-plane/0.3x0.3x0.3/magnitude", 0.038, 0.102},
    {"trilinear/tilted-plane/0.3x0.3x0.3/sigma-1.0/direction", 0.164, 0.203},
    {"trilinear/tilted-plane/0.3x0.3x0.3/sigma-1.0/magnitude", 0.110, 0.270},
    {"trilinear/torus-20-8mm/0.28x0.28x1.0/direction", 0.970, 4.101},
    {"trilinear/torus-20-8mm/0.28x0.28x1.0/magnitude", 0.316, 2.043},
    {"trilinear/torus-20-8mm/0.28x0.28x1.0/sigma-1.0/direction", 1.799, 9.120},
    {"trilinear/torus-20-8mm/0.28x0.28x1.0/sigma-1.0/magnitude", 0.763, 4.846},
    {"trilinear/torus-20-8mm/0.625x0.625x0.9/direction", 1.003, 3.072},
    {"trilinear/torus-20-8mm/0.625x0.625x0.9/magnitude", 0.508, 2.089},
    {"trilinear/torus-20-8mm/0.625x0.625x0.9/sigma-1.0/direction", 1.935, 7.142},
    {"trilinear/torus-20-8mm/0.625x0.625x0.9/sigma-1.0/magnitude", 1.157, 4.475},
    {"trilinear/torus-20-8mm/0.3x0.3x0.3/direction", 0.349, 0.827},
    {"trilinear/torus-20-8mm/0.3x0.3x0.3/magnitude", 0.083, 0.393},
    {"trilinear/torus-20-8mm/0.3x0.3x0.3/sigma-1.0/direction", 0.351, 1.142},
    {"trilinear/torus-20-8mm/0.3x0.3x0.3/sigma-1.0/magnitude", 0.190, 0.855},
    {"trilinear-exact-u16/sphere-20mm/0.28x0.28x1.0/direction", 0.526, 1.410},
    {"trilinear-exact-u16/sphere-20mm/0.28x0.28x1.0/magnitude", 0.181, 0.760},
    {"trilinear-exact-u16/sphere-20mm/0.625x0.625x0.9/direction", 0.432, 1.029},
    {"trilinear-exact-u16/sphere-20mm/0.625x0.625x0.9/magnitude", 0.227, 0.709},
    {"trilinear-exact-u16/sphere-20mm/0.3x0.3x0.3/direction", 0.070, 0.114},
    {"trilinear-exact-u16/sphere-20mm/0.3x0.3x0.3/magnitude", 0.039, 0.111},
    {"trilinear-exact-u16/cylinder-10mm/0.28x0.28x1.0/direction", 0.287, 0.701},
    {"trilinear-exact-u16/cylinder-10mm/0.28x0.28x1.0/magnitude", 0.117, 0.360},
    {"trilinear-exact-u16/cylinder-10mm/0.625x0.625x0.9/direction", 0.260, 0.452},
    {"trilinear-exact-u16/cylinder-10mm/0.625x0.625x0.9/magnitude", 0.202, 0.550},
    {"trilinear-exact-u16/cylinder-10mm/0.3x0.3x0.3/direction", 0.069, 0.111},
    {"trilinear-exact-u16/cylinder-10mm/0.3x0.3x0.3/magnitude", 0.040, 0.110},
    {"trilinear-exact-u16/tilted-plane/0.28x0.28x1.0/direction", 1.213, 1.364},
    {"trilinear-exact-u16/tilted-plane/0.28x0.28x1.0/magnitude", 0.255, 0.670},
    {"trilinear-exact-u16/tilted-plane/0.625x0.625x0.9/direction", 0.861, 0.964},
    {"trilinear-exact-u16/tilted-plane/0.625x0.625x0.9/magnitude", 0.250, 0.631},
    {"trilinear-exact-u16/tilted-plane/0.3x0.3x0.3/direction", 0.083, 0.092},
    {"trilinear-exact-u16/tilted-plane/0.3x0.3x0.3/magnitude", 0.035, 0.085},
    {"trilinear-exact-u16/torus-20-8mm/0.28x0.28x1.0/direction", 0.755, 1.512},
    {"trilinear-exact-u16/torus-20-8mm/0.28x0.28x1.0/magnitude", 0.246, 0.783},
    {"trilinear-exact-u16/torus-20-8mm/0.625x0.625x0.9/direction", 0.521, 1.064},
    {"trilinear-exact-u16/torus-20-8mm/0.625x0.625x0.9/magnitude", 0.259, 0.770},
    {"trilinear-exact-u16/torus-20-8mm/0.3x0.3x0.3/direction", 0.068, 0.115},
    {"trilinear-exact-u16/torus-20-8mm/0.3x0.3x0.3/magnitude", 0.041, 0.121},
    {"trilinear-u8/sphere-20mm/0.28x0.28x1.0/direction", 0.852, 4.502},
    {"trilinear-u8/sphere-20mm/0.28x0.28x1.0/magnitude", 0.289, 2.879},
    {"trilinear-u8/sphere-20mm/0.625x0.625x0.9/direction", 0.910, 5.008},
    {"trilinear-u8/sphere-20mm/0.625x0.625x0.9/magnitude", 0.480, 2.213},
    {"trilinear-u8/sphere-20mm/0.3x0.3x0.3/direction", 0.492, 1.315},
    {"trilinear-u8/sphere-20mm/0.3x0.3x0.3/magnitude", 0.107, 0.550},
    {"trilinear-u8/cylinder-10mm/0.28x0.28x1.0/direction", 0.554, 1.378},
    {"trilinear-u8/cylinder-10mm/0.28x0.28x1.0/magnitude", 0.177, 0.594},
    {"trilinear-u8/cylinder-10mm/0.625x0.625x0.9/direction", 0.770, 2.123},
    {"trilinear-u8/cylinder-10mm/0.625x0.625x0.9/magnitude", 0.429, 1.443},
    {"trilinear-u8/cylinder-10mm/0.3x0.3x0.3/direction", 0.474, 1.200},
    {"trilinear-u8/cylinder-10mm/0.3x0.3x0.3/magnitude", 0.098, 0.308},
    {"trilinear-u8/tilted-plane/0.28x0.28x1.0/direction", 1.252, 2.127},
    {"trilinear-u8/tilted-plane/0.28x0.28x1.0/magnitude", 0.297, 0.808},
    {"trilinear-u8/tilted-plane/0.625x0.625x0.9/direction", 0.879, 1.357},
    {"trilinear-u8/tilted-plane/0.625x0.625x0.9/magnitude", 0.277, 0.747},
    {"trilinear-u8/tilted-plane/0.3x0.3x0.3/direction", 0.546, 1.204},
    {"trilinear-u8/tilted-plane/0.3x0.3x0.3/magnitude", 0.071, 0.220},
    {"trilinear-u8/torus-20-8mm/0.28x0.28x1.0/direction", 1.062, 4.159},
    {"trilinear-u8/torus-20-8mm/0.28x0.28x1.0/magnitude", 0.321, 1.993},
    {"trilinear-u8/torus-20-8mm/0.625x0.625x0.9/direction", 1.023, 3.072},
    {"trilinear-u8/torus-20-8mm/0.625x0.625x0.9/magnitude", 0.511, 2.077},
    {"trilinear-u8/torus-20-8mm/0.3x0.3x0.3/direction", 0.570, 1.399},
    {"trilinear-u8/torus-20-8mm/0.3x0.3x0.3/magnitude", 0.100, 0.399},
});

// The same for methods added later, by method and shape (followed by the part of the name between spacing and
// quantity): direction in degrees, mean and p99, for the three spacings in order.
struct Direction {
  double mean, p99;
};
struct DirectionLimits {
  std::string_view shape;
  std::array<Direction, 3> on;
};
constexpr std::array kDirectionLimits = std::to_array<DirectionLimits>({
    {"b-spline/sphere-20mm", {{{0.351, 3.719}, {0.826, 4.702}, {0.146, 0.727}}}},
    {"b-spline/sphere-20mm/sigma-1.0", {{{0.927, 9.008}, {2.014, 9.375}, {0.301, 1.713}}}},
    {"b-spline/cylinder-10mm", {{{0.236, 0.764}, {0.773, 2.401}, {0.122, 0.468}}}},
    {"b-spline/cylinder-10mm/sigma-1.0", {{{0.525, 1.71}, {1.774, 5.255}, {0.273, 1.077}}}},
    {"b-spline/tilted-plane", {{{0.187, 0.401}, {0.258, 0.521}, {0.009, 0.02}}}},
    {"b-spline/tilted-plane/sigma-1.0", {{{0.346, 0.972}, {0.837, 1.765}, {0.007, 0.016}}}},
    {"b-spline/torus-20-8mm", {{{0.522, 3.324}, {0.882, 3.256}, {0.34, 0.804}}}},
    {"b-spline/torus-20-8mm/sigma-1.0", {{{0.979, 8.225}, {1.872, 7.707}, {0.33, 1.162}}}},
    {"b-spline-exact-distance-int16/sphere-20mm", {{{0.055, 0.148}, {0.028, 0.067}, {0.061, 0.139}}}},
    {"b-spline-exact-distance-int16/cylinder-10mm", {{{0.051, 0.134}, {0.028, 0.065}, {0.062, 0.141}}}},
    {"b-spline-exact-distance-int16/tilted-plane", {{{0.083, 0.182}, {0.024, 0.046}, {0.053, 0.156}}}},
    {"b-spline-exact-distance-int16/torus-20-8mm", {{{0.053, 0.132}, {0.027, 0.063}, {0.059, 0.135}}}},
    {"b-spline-exact-int16/sphere-20mm", {{{0.018, 0.079}, {0.015, 0.054}, {0.005, 0.01}}}},
    {"b-spline-exact-int16/cylinder-10mm", {{{0.008, 0.024}, {0.01, 0.024}, {0.006, 0.012}}}},
    {"b-spline-exact-int16/tilted-plane", {{{0.038, 0.077}, {0.026, 0.051}, {0.009, 0.018}}}},
    {"b-spline-exact-int16/torus-20-8mm", {{{0.026, 0.085}, {0.019, 0.059}, {0.005, 0.01}}}},
    {"b-spline-exact-u16/sphere-20mm", {{{0.02, 0.08}, {0.015, 0.054}, {0.009, 0.018}}}},
    {"b-spline-exact-u16/cylinder-10mm", {{{0.01, 0.027}, {0.01, 0.025}, {0.009, 0.021}}}},
    {"b-spline-exact-u16/tilted-plane", {{{0.039, 0.078}, {0.026, 0.052}, {0.011, 0.023}}}},
    {"b-spline-exact-u16/torus-20-8mm", {{{0.027, 0.086}, {0.02, 0.06}, {0.009, 0.019}}}},
    {"b-spline-exact-u8/sphere-20mm", {{{1.391, 3.635}, {0.703, 1.654}, {1.63, 3.82}}}},
    {"b-spline-exact-u8/cylinder-10mm", {{{1.338, 3.697}, {0.692, 1.643}, {1.631, 3.7}}}},
    {"b-spline-exact-u8/tilted-plane", {{{1.519, 3.644}, {0.572, 1.429}, {1.761, 3.804}}}},
    {"b-spline-exact-u8/torus-20-8mm", {{{1.463, 3.715}, {0.709, 1.663}, {1.601, 3.677}}}},
    {"b-spline-u8/sphere-20mm", {{{1.516, 4.491}, {1.122, 4.746}, {1.644, 3.771}}}},
    {"b-spline-u8/cylinder-10mm", {{{1.364, 3.614}, {1.056, 2.726}, {1.649, 3.763}}}},
    {"b-spline-u8/tilted-plane", {{{1.506, 3.843}, {0.816, 1.921}, {1.73, 3.604}}}},
    {"b-spline-u8/torus-20-8mm", {{{1.582, 4.564}, {1.151, 3.491}, {1.673, 3.851}}}},
    {"gaussian-sphere/sphere-20mm", {{{8.475, 38.177}, {4.156, 16.14}, {4.593, 15.819}}}},
    {"gaussian-sphere/cylinder-10mm", {{{4.467, 12.208}, {3.137, 8.277}, {4.462, 14.548}}}},
    {"gaussian-sphere/tilted-plane", {{{17.372, 30.731}, {3.524, 6.393}, {4.96, 13.733}}}},
    {"gaussian-sphere/torus-20-8mm", {{{10.941, 38.161}, {4.118, 15.048}, {4.528, 15.047}}}},
    {"smooth-sphere/sphere-20mm", {{{0.334, 2.904}, {0.71, 4.156}, {0.169, 0.663}}}},
    {"smooth-sphere/sphere-20mm/sigma-1.0", {{{0.8, 7.532}, {1.736, 8.736}, {0.288, 1.541}}}},
    {"smooth-sphere/cylinder-10mm", {{{0.241, 0.667}, {0.667, 1.952}, {0.163, 0.441}}}},
    {"smooth-sphere/cylinder-10mm/sigma-1.0", {{{0.493, 1.537}, {1.549, 4.653}, {0.254, 0.9}}}},
    {"smooth-sphere/tilted-plane", {{{0.169, 0.33}, {0.226, 0.42}, {0.002, 0.004}}}},
    {"smooth-sphere/tilted-plane/sigma-1.0", {{{0.289, 0.908}, {0.578, 1.469}, {0.008, 0.018}}}},
    {"smooth-sphere/torus-20-8mm", {{{0.548, 3.06}, {0.842, 2.764}, {0.402, 1.104}}}},
    {"smooth-sphere/torus-20-8mm/sigma-1.0", {{{0.853, 6.979}, {1.635, 6.613}, {0.335, 1.014}}}},
    {"stored-normals/sphere-20mm", {{{0.77, 4.478}, {1.026, 4.866}, {0.293, 0.838}}}},
    {"stored-normals/sphere-20mm/sigma-1.0", {{{1.452, 10.328}, {1.94, 9}, {0.41, 1.63}}}},
    {"stored-normals/cylinder-10mm", {{{0.555, 1.232}, {1.015, 2.451}, {0.34, 0.86}}}},
    {"stored-normals/cylinder-10mm/sigma-1.0", {{{0.851, 2.05}, {1.646, 4.457}, {0.439, 1.211}}}},
    {"stored-normals/tilted-plane", {{{1.185, 1.432}, {0.842, 1.172}, {0.175, 0.279}}}},
    {"stored-normals/tilted-plane/sigma-1.0", {{{2.1, 3.241}, {1.528, 2.766}, {0.259, 0.279}}}},
    {"stored-normals/torus-20-8mm", {{{1.08, 4.139}, {1.35, 3.592}, {0.514, 1.383}}}},
    {"stored-normals/torus-20-8mm/sigma-1.0", {{{1.779, 8.852}, {2.058, 7.237}, {0.534, 1.41}}}},
    {"stored-normals-exact-u16/sphere-20mm", {{{0.622, 1.601}, {0.673, 1.587}, {0.249, 0.513}}}},
    {"stored-normals-exact-u16/cylinder-10mm", {{{0.502, 1.087}, {0.737, 1.757}, {0.312, 0.778}}}},
    {"stored-normals-exact-u16/tilted-plane", {{{1.249, 1.432}, {0.9, 1.069}, {0.179, 0.279}}}},
    {"stored-normals-exact-u16/torus-20-8mm", {{{0.917, 2.081}, {1.057, 2.451}, {0.404, 0.97}}}},
    {"stored-normals-exact-u8/sphere-20mm", {{{0.697, 1.802}, {0.688, 1.59}, {0.406, 0.976}}}},
    {"stored-normals-exact-u8/cylinder-10mm", {{{0.572, 1.344}, {0.753, 1.819}, {0.459, 1.107}}}},
    {"stored-normals-exact-u8/tilted-plane", {{{1.196, 1.749}, {0.866, 1.162}, {0.362, 0.768}}}},
    {"stored-normals-exact-u8/torus-20-8mm", {{{0.964, 2.199}, {1.067, 2.503}, {0.521, 1.258}}}},
    {"stored-normals-oct16/sphere-20mm", {{{0.781, 4.561}, {1.03, 4.895}, {0.308, 0.887}}}},
    {"stored-normals-oct16/cylinder-10mm", {{{0.572, 1.326}, {1.017, 2.458}, {0.369, 0.893}}}},
    {"stored-normals-oct16/tilted-plane", {{{1.165, 1.871}, {0.815, 1.004}, {0.177, 0.177}}}},
    {"stored-normals-oct16/torus-20-8mm", {{{1.083, 4.112}, {1.355, 3.621}, {0.528, 1.412}}}},
    {"stored-normals-oct24/sphere-20mm", {{{0.767, 4.504}, {1.023, 4.904}, {0.281, 0.842}}}},
    {"stored-normals-oct24/cylinder-10mm", {{{0.548, 1.222}, {1.011, 2.432}, {0.332, 0.82}}}},
    {"stored-normals-oct24/tilted-plane", {{{1.177, 1.616}, {0.829, 1.181}, {0.091, 0.092}}}},
    {"stored-normals-oct24/torus-20-8mm", {{{1.077, 4.136}, {1.348, 3.581}, {0.508, 1.381}}}},
    {"trilinear-exact-distance-int16/sphere-20mm", {{{0.028, 0.055}, {0.016, 0.032}, {0.016, 0.038}}}},
    {"trilinear-exact-distance-int16/cylinder-10mm", {{{0.027, 0.055}, {0.026, 0.048}, {0.017, 0.04}}}},
    {"trilinear-exact-distance-int16/tilted-plane", {{{0.017, 0.035}, {0.002, 0.002}, {0.002, 0.002}}}},
    {"trilinear-exact-distance-int16/torus-20-8mm", {{{0.101, 0.26}, {0.067, 0.177}, {0.018, 0.044}}}},
    {"trilinear-exact-u8/sphere-20mm", {{{0.705, 1.881}, {0.482, 1.222}, {0.454, 1.223}}}},
    {"trilinear-exact-u8/cylinder-10mm", {{{0.488, 1.237}, {0.326, 0.732}, {0.453, 1.101}}}},
    {"trilinear-exact-u8/tilted-plane", {{{1.287, 2.052}, {0.867, 1.197}, {0.52, 1.202}}}},
    {"trilinear-exact-u8/torus-20-8mm", {{{0.892, 1.971}, {0.56, 1.261}, {0.45, 1.172}}}},
});

// Choppiness, p99, percent of full force.
struct ChoppinessLimits {
  std::string_view shape;
  std::array<double, 3> on;
};
constexpr std::array kChoppinessLimits = std::to_array<ChoppinessLimits>({
    {"b-spline/sphere-20mm", {0.044, 0.052, 0.04}},
    {"b-spline/torus-20-8mm", {0.099, 0.1, 0.1}},
    {"b-spline-u8/sphere-20mm", {0.292, 0.09, 0.28}},
    {"b-spline-u8/torus-20-8mm", {0.283, 0.12, 0.289}},
    {"gaussian-sphere/sphere-20mm", {1.235, 1.085, 1.592}},
    {"gaussian-sphere/torus-20-8mm", {1.465, 1.258, 1.737}},
    {"gaussian-sphere-sigma-2/sphere-20mm", {3.151, 2.918, 3.97}},
    {"gaussian-sphere-sigma-2/torus-20-8mm", {3.176, 3.33, 4.284}},
    {"smooth-sphere/sphere-20mm", {0.04, 0.049, 0.039}},
    {"smooth-sphere/torus-20-8mm", {0.099, 0.101, 0.1}},
    {"stored-normals/sphere-20mm", {3.653, 4.288, 3.447}},
    {"stored-normals/torus-20-8mm", {3.83, 5.531, 3.69}},
    {"stored-normals-oct16/sphere-20mm", {3.656, 4.287, 3.45}},
    {"stored-normals-oct16/torus-20-8mm", {3.826, 5.534, 3.691}},
    {"stored-normals-oct24/sphere-20mm", {3.655, 4.281, 3.448}},
    {"stored-normals-oct24/torus-20-8mm", {3.831, 5.529, 3.695}},
    {"trilinear/sphere-20mm", {0.045, 0.051, 0.04}},
    {"trilinear/torus-20-8mm", {0.097, 0.099, 0.099}},
    {"trilinear-u8/sphere-20mm", {0.089, 0.054, 0.093}},
    {"trilinear-u8/torus-20-8mm", {0.117, 0.098, 0.134}},
});

// parts of the name method/shape/spacing[/more]/quantity, without spacing and quantity
struct Location {
  std::string shape;
  std::size_t spacing;
  std::string_view quantity;
};

std::optional<Location> location_of(std::string_view path) {
  const auto first = path.find('/'), second = path.find('/', first + 1), last = path.rfind('/');
  if (second == std::string_view::npos || last == second) return {};
  const auto third = path.find('/', second + 1);
  const std::string_view spacing = path.substr(second + 1, third - second - 1);
  const auto& all = accuracy_spacings();
  const auto found =
      std::find_if(all.begin(), all.end(), [&](const AccuracySpacing& one) { return one.name == spacing; });
  if (found == all.end()) return {};
  return Location{std::string(path.substr(0, second)) + std::string(path.substr(third, last - third)),
                  static_cast<std::size_t>(found - all.begin()), path.substr(last + 1)};
}

template <class Limits>
const Limits* find_limits(std::span<const Limits> all, std::string_view shape) {
  const auto found =
      std::find_if(all.begin(), all.end(), [&](const Limits& one) { return one.shape == shape; });
  return found == all.end() ? nullptr : &*found;
}

std::optional<double> limit_by_shape(std::string_view path, std::string_view leaf) {
  const auto location = location_of(path);
  if (!location) return {};
  if (location->quantity == "direction") {
    const auto* limits = find_limits<DirectionLimits>(kDirectionLimits, location->shape);
    if (limits == nullptr) return {};
    if (leaf == "mean") return limits->on[location->spacing].mean;
    if (leaf == "p99") return limits->on[location->spacing].p99;
  }
  if (location->quantity == "choppiness" && leaf == "p99") {
    const auto* limits = find_limits<ChoppinessLimits>(kChoppinessLimits, location->shape);
    if (limits != nullptr) return limits->on[location->spacing];
  }
  return {};
}

}  // namespace

std::optional<double> accuracy_limit(const std::string& figure) {
  const auto slash = figure.rfind('/');
  if (slash == std::string::npos) return {};
  const std::string_view path(figure.data(), slash), leaf(figure.data() + slash + 1);
  const auto* limit =
      std::find_if(kLimits.begin(), kLimits.end(), [&](const Limit& known) { return known.path == path; });
  if (limit == kLimits.end()) return limit_by_shape(path, leaf);
  if (leaf == "mean") return limit->mean;
  if (leaf == "p99") return limit->p99;
  return {};
}

}  // namespace palpate
