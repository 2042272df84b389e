// Cost of a tick with many structures: a ball of any number of regions, touched by a tool of one and of four
// spheres, or with a shaft. See README.md.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <random>

#include "json_file.h"
#include "palpate/loading/loading.h"
#include "palpate/scene/scene.h"
#include "palpate/servo/servo.h"

namespace palpate::bench {

namespace {

constexpr double kBall_mm = 45, kVoxel_mm = 1, kTick_s = 1e-3;

struct Options {
  int structures = 250, presses = 60, repeats = 20;
  double speed_mm_s = 50;
  std::string json;
};

// partitions a ball into Voronoi regions of random seeds
LabelMap regions_of(int structures, std::mt19937& random) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> unit(0, 1);
  std::vector<Eigen::Vector3d> seeds;
  for (int n = 0; n < structures; ++n) {
    const double z = normal(random), y = normal(random), x = normal(random);
    seeds.push_back(Eigen::Vector3d(x, y, z).normalized() * (kBall_mm * std::cbrt(unit(random))));
  }
  LabelMap map;
  GridGeometry grid;
  grid.dims.fill(static_cast<int>(2 * (kBall_mm + 6) / kVoxel_mm) + 1);
  grid.spacing_mm.setConstant(kVoxel_mm);
  grid.origin = Point<Patient>(-kBall_mm - 6, -kBall_mm - 6, -kBall_mm - 6);
  Volume<LabelId> labels(grid);
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k) {
    for (int j = 0; j < grid.dims[1]; ++j) {
      for (int i = 0; i < grid.dims[0]; ++i) {
        const Eigen::Vector3d p = (X_PatientVoxel * Point<Voxel>(i, j, k)).eigen();
        if (p.norm() > kBall_mm) continue;
        const auto nearest = std::min_element(seeds.begin(), seeds.end(), [&](const auto& a, const auto& b) {
          return (a - p).squaredNorm() < (b - p).squaredNorm();
        });
        labels.at(i, j, k) = static_cast<LabelId>(nearest - seeds.begin() + 1);
      }
    }
  }
  map.layers.push_back(std::move(labels));
  for (int n = 1; n <= structures; ++n)
    map.segments.push_back(
        {static_cast<LabelId>(n), "region " + std::to_string(n), {}, 0, static_cast<LabelId>(n)});
  return map;
}

Result<std::shared_ptr<const Model>> model_of(const LabelMap& labels) {
  std::string all;
  for (const Segment& segment : labels.segments)
    all += (all.empty() ? "" : ", ") + std::to_string(segment.id);
  auto scene = parse_scene(
      "title = \"regions\"\n[data]\nlabels = \"regions.nrrd\"\n[[tissue]]\nname = \"all\"\nlabels = [" + all +
          "]\nstiffness = 1\nfriction = 0.1\n",
      "regions");
  if (!scene) return scene.error();
  auto model = build_model(*scene, &labels, nullptr);
  if (!model) return model.error();
  constexpr std::array kProxy{ForceMethod::kProxy};
  return prepared_with_cache(*std::move(model), kProxy);
}

// presses and slides at random positions, at half to full speed, with rotations of the tool about its tip
std::vector<DeviceState> path_of(int presses, double speed_mm_s, std::mt19937& random) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> unit(0, 1);
  const auto direction = [&] {
    const double z = normal(random), y = normal(random), x = normal(random);
    return Vector<World>(x, y, z).normalized();
  };
  std::vector<DeviceState> path;
  double angle = 0;
  const auto add = [&](const Point<World>& tip) {
    DeviceState state;
    state.tip = tip;
    // up to 2 rad/s
    state.R_WorldTool = Eigen::AngleAxisd(angle += 0.002 * std::sin(0.003 * static_cast<double>(path.size())),
                                          Eigen::Vector3d(0.6, 0, 0.8));
    path.push_back(state);
  };
  for (int press = 0; press < presses; ++press) {
    const Vector<World> outward = direction();
    const Vector<World> along = outward.cross(direction()).normalized();
    const double max_mm = 1 + 2 * unit(random),
                 distance_mm = kTick_s * speed_mm_s * (0.5 + 0.5 * unit(random));
    for (double above_mm = 8; above_mm > -max_mm; above_mm -= distance_mm)
      add(Point<World>() + outward * (kBall_mm + above_mm));
    const Point<World> pressed = Point<World>() + outward * (kBall_mm - max_mm);
    for (double slid_mm = 0; slid_mm < 10; slid_mm += distance_mm) add(pressed + along * slid_mm);
    for (double above_mm = -max_mm; above_mm < 8; above_mm += distance_mm)
      add(pressed + along * 10 + outward * (above_mm + max_mm));
  }
  return path;
}

double percentile(std::vector<double> values, double part) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1))];
}

std::vector<Tool> tools() {
  Tool one;
  one.name = "1 sphere";
  one.radius_mm = 1;
  Tool four = one, shaft = one;
  four.name = "4 spheres";
  four.points_mm = {{0, 0, 0}, {6, 0, 3}, {0, 6, 3}, {-6, 0, 20}};
  shaft.name = "shaft of 40 mm";
  shaft.capsules = {{{0, 0, 0}, {-12, 0, 38}, 1}};
  return {one, four, shaft};
}

nlohmann::json rendered_by(Model model, const Tool& tool, const std::vector<DeviceState>& path, int repeats) {
  model.tools = {tool};
  Parameters parameters;
  parameters.method = ForceMethod::kProxy;
  std::vector<double> min_us(path.size(), 1e9), p50_us, p99_us;
  std::size_t touched = 0;
  for (int repeat = 0; repeat < repeats; ++repeat) {
    SessionState state;
    Wrench wrench;
    TickRecord record;
    std::vector<double> taken_us;
    touched = 0;
    for (std::size_t n = 0; n < path.size(); ++n) {
      const auto begun = std::chrono::steady_clock::now();
      tick(model, parameters, {&path[n], 1}, kTick_s, state, {&wrench, 1}, record);
      taken_us.push_back(
          std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - begun).count());
      min_us[n] = std::min(min_us[n], taken_us.back());
      touched += (record.device[0].flags & kFlagContact) != 0;
    }
    p50_us.push_back(percentile(taken_us, 0.5));
    p99_us.push_back(percentile(taken_us, 0.99));
  }
  const double p50 = percentile(p50_us, 0.5), p99 = percentile(p99_us, 0.5);
  const double min_p99 = percentile(min_us, 0.99);
  const double largest = *std::max_element(min_us.begin(), min_us.end());
  const double contact = static_cast<double>(touched) / static_cast<double>(path.size());
  std::printf(
      "%-14s p50 %.2f, p99 %.2f us; least of %d repeats: p99 %.2f, largest %.2f us; %.0f %% in contact\n",
      tool.name.c_str(), p50, p99, repeats, min_p99, largest, 100 * contact);
  return {{"tool", tool.name},           {"p50_us", p50},        {"p99_us", p99}, {"min_p99_us", min_p99},
          {"largest_least_us", largest}, {"in_contact", contact}};
}

int run(const Options& options) {
  std::mt19937 random(7);
  const auto model = model_of(regions_of(options.structures, random));
  if (!model) {
    std::fprintf(stderr, "crowd_bench: %s\n", model.error().message().c_str());
    return 2;
  }
  const auto path = path_of(options.presses, options.speed_mm_s, random);
  std::printf("%zu structures, %zu ticks\n", (*model)->label_of_surface.size(), path.size());
  nlohmann::json json = {{"structures", (*model)->label_of_surface.size()}, {"ticks", path.size()}};
  for (const Tool& tool : tools()) json["tools"].push_back(rendered_by(**model, tool, path, options.repeats));
  return write_json("crowd_bench", options.json, json);
}

}  // namespace

}  // namespace palpate::bench

int main(int argc, char** argv) {
  palpate::bench::Options options;
  CLI::App app("the tick among many structures");
  app.add_option("--structures", options.structures, "regions of the ball")->check(CLI::Range(1, 256));
  app.add_option("--presses", options.presses)->check(CLI::Range(1, 10'000));
  app.add_option("--repeats", options.repeats)->check(CLI::Range(1, 1000));
  app.add_option("--speed", options.speed_mm_s, "mm/s, at most")->check(CLI::Range(1, 1000));
  app.add_option("--json", options.json, "write the figures here");
  CLI11_PARSE(app, argc, argv);
  return palpate::bench::run(options);
}
