// Error of storing normals: tilt of the stored surface as a function of the true tilt, and errors over all
// directions. See README.md.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <numeric>
#include <random>

#include "json_file.h"
#include "palpate/sampling/stored_normals.h"

namespace palpate::bench {

namespace {

struct Options {
  double most_degrees = 3, step_degrees = 0.005;
  int directions = 1'000'000;
  unsigned seed = 1;
  std::string json;
};

struct Encoding {
  NormalEncoding encoding;
  const char* name;
};
constexpr Encoding kEncodings[] = {{NormalEncoding::kBytes, "3 bytes"},
                                   {NormalEncoding::kOctahedral16, "octahedral 16"},
                                   {NormalEncoding::kOctahedral24, "octahedral 24"}};

double degrees(double radians) {
  return radians * 180 / std::numbers::pi;
}

/// Angles between random directions and their stored values, ascending.
std::vector<double> errors_deg(NormalEncoding encoding, const Options& options) {
  std::mt19937 random(options.seed);
  std::normal_distribution<double> normal;
  std::vector<double> errors(static_cast<std::size_t>(options.directions));
  for (double& error : errors) {
    const auto direction = Vector<Patient>(normal(random), normal(random), normal(random)).normalized();
    error = degrees(std::asin(stored_normal(direction, encoding).cross(direction).norm()));
  }
  std::sort(errors.begin(), errors.end());
  return errors;
}

int run(const Options& options) {
  std::vector<double> true_tilts;
  const int steps = static_cast<int>(std::lround(options.most_degrees / options.step_degrees));
  for (int n = 0; n <= steps; ++n) true_tilts.push_back(n * options.step_degrees);

  std::printf("errors over %d random directions, seed %u, in degrees; tilts left of %zu up to %g degrees\n",
              options.directions, options.seed, true_tilts.size(), options.most_degrees);
  std::printf("%-16s %6s %8s %8s %8s %7s\n", "", "bytes", "mean", "p99", "max", "tilts");
  nlohmann::json encodings = nlohmann::json::array();
  for (const auto& [encoding, name] : kEncodings) {
    const auto errors = errors_deg(encoding, options);
    const double mean =
        std::accumulate(errors.begin(), errors.end(), 0.0) / static_cast<double>(errors.size());
    const double p99 = errors[errors.size() * 99 / 100];

    // from the z axis towards x
    std::vector<double> tilts;
    for (const double tilt : true_tilts) {
      const double t = tilt * std::numbers::pi / 180;
      const auto stored = stored_normal(Vector<Patient>(std::sin(t), 0, std::cos(t)), encoding);
      tilts.push_back(degrees(std::atan2(stored.x(), stored.z())));
    }
    auto distinct = tilts;
    distinct.erase(std::unique(distinct.begin(), distinct.end()), distinct.end());

    std::printf("%-16s %6d %8.4f %8.4f %8.4f %7zu\n", name, normal_bytes(encoding), mean, p99, errors.back(),
                distinct.size());
    encodings.push_back({{"name", name},
                         {"normal_bytes", normal_bytes(encoding)},
                         {"mean_degrees", mean},
                         {"p99_degrees", p99},
                         {"max_degrees", errors.back()},
                         {"distinct_tilts", distinct.size()},
                         {"stored_tilt_degrees", tilts}});
  }
  return write_json("stored_normals_curve", options.json,
                    {{"directions", options.directions},
                     {"seed", options.seed},
                     {"true_tilt_degrees", true_tilts},
                     {"encodings", encodings}});
}

}  // namespace

}  // namespace palpate::bench

int main(int argc, char** argv) {
  palpate::bench::Options options;
  CLI::App app("What storing a normal costs: tilts that remain, and errors over all directions");
  app.add_option("--most", options.most_degrees, "largest tilt in degrees")
      ->check(CLI::Range(0.1, 90.0))
      ->capture_default_str();
  app.add_option("--step", options.step_degrees, "from tilt to tilt in degrees")
      ->check(CLI::Range(1e-4, 1.0))
      ->capture_default_str();
  app.add_option("--directions", options.directions, "random directions")
      ->check(CLI::Range(1000, 100'000'000))
      ->capture_default_str();
  app.add_option("--seed", options.seed, "of the random directions")->capture_default_str();
  app.add_option("--json", options.json, "write the figures to this file");
  CLI11_PARSE(app, argc, argv);
  return palpate::bench::run(options);
}
