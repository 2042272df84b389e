#include <algorithm>
#include <array>
#include <string_view>

#include "verification/accuracy.h"

namespace palpate {
namespace {

struct Limit {
  std::string_view path;
  double mean, p99;
};

// What was measured when the method was built, and a tenth more: the suite has no chance in it, so a
// figure that moves by more means that the method changed.
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
    {"trilinear-exact/sphere-20mm/0.28x0.28x1.0/direction", 0.526, 1.410},
    {"trilinear-exact/sphere-20mm/0.28x0.28x1.0/magnitude", 0.181, 0.760},
    {"trilinear-exact/sphere-20mm/0.625x0.625x0.9/direction", 0.432, 1.029},
    {"trilinear-exact/sphere-20mm/0.625x0.625x0.9/magnitude", 0.227, 0.709},
    {"trilinear-exact/sphere-20mm/0.3x0.3x0.3/direction", 0.070, 0.114},
    {"trilinear-exact/sphere-20mm/0.3x0.3x0.3/magnitude", 0.039, 0.111},
    {"trilinear-exact/cylinder-10mm/0.28x0.28x1.0/direction", 0.287, 0.701},
    {"trilinear-exact/cylinder-10mm/0.28x0.28x1.0/magnitude", 0.117, 0.360},
    {"trilinear-exact/cylinder-10mm/0.625x0.625x0.9/direction", 0.260, 0.452},
    {"trilinear-exact/cylinder-10mm/0.625x0.625x0.9/magnitude", 0.202, 0.550},
    {"trilinear-exact/cylinder-10mm/0.3x0.3x0.3/direction", 0.069, 0.111},
    {"trilinear-exact/cylinder-10mm/0.3x0.3x0.3/magnitude", 0.040, 0.110},
    {"trilinear-exact/tilted-plane/0.28x0.28x1.0/direction", 1.213, 1.364},
    {"trilinear-exact/tilted-plane/0.28x0.28x1.0/magnitude", 0.255, 0.670},
    {"trilinear-exact/tilted-plane/0.625x0.625x0.9/direction", 0.861, 0.964},
    {"trilinear-exact/tilted-plane/0.625x0.625x0.9/magnitude", 0.250, 0.631},
    {"trilinear-exact/tilted-plane/0.3x0.3x0.3/direction", 0.083, 0.092},
    {"trilinear-exact/tilted-plane/0.3x0.3x0.3/magnitude", 0.035, 0.085},
    {"trilinear-exact/torus-20-8mm/0.28x0.28x1.0/direction", 0.755, 1.512},
    {"trilinear-exact/torus-20-8mm/0.28x0.28x1.0/magnitude", 0.246, 0.783},
    {"trilinear-exact/torus-20-8mm/0.625x0.625x0.9/direction", 0.521, 1.064},
    {"trilinear-exact/torus-20-8mm/0.625x0.625x0.9/magnitude", 0.259, 0.770},
    {"trilinear-exact/torus-20-8mm/0.3x0.3x0.3/direction", 0.068, 0.115},
    {"trilinear-exact/torus-20-8mm/0.3x0.3x0.3/magnitude", 0.041, 0.121},
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

}  // namespace

std::optional<double> accuracy_limit(const std::string& figure) {
  const auto slash = figure.rfind('/');
  if (slash == std::string::npos) return {};
  const std::string_view path(figure.data(), slash), leaf(figure.data() + slash + 1);
  const auto* limit =
      std::find_if(kLimits.begin(), kLimits.end(), [&](const Limit& known) { return known.path == path; });
  if (limit == kLimits.end()) return {};
  if (leaf == "mean") return limit->mean;
  if (leaf == "p99") return limit->p99;
  return {};
}

}  // namespace palpate
