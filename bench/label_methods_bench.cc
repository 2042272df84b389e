// The force methods on raw labels and stored normals: literal and vector forms in one run. See README.md.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>

#include "interleaved.h"
#include "palpate/preparation.h"
#include "palpate/voxel_methods.h"

namespace palpate::bench {

namespace {

struct Options {
  double sigma_mm = 1.5;
  int rounds = 9, points = 4000;
  std::string json;
};

// ---- the work ---------------------------------------------------------------------------------------------

constexpr double kBoneRadius = 24, kGap = 3;

/// Two bones with rounded ends along y, 3 mm apart, labels 1 and 2.
std::shared_ptr<const Volume<LabelId>> two_bones() {
  GridGeometry grid;
  grid.dims = {256, 256, 124};
  grid.spacing_mm = {0.625, 0.625, 0.9};
  auto labels = std::make_shared<Volume<LabelId>>(grid);
  const auto inside = [](const Eigen::Vector3d& from_end, double away) {
    const double along = from_end[1] * away;
    const double across = std::hypot(from_end[0], from_end[2]);
    return along > 0 ? across < kBoneRadius : std::hypot(across, along) < kBoneRadius;
  };
  const Eigen::Vector3d offset(0, kBoneRadius + kGap / 2, 0);
  for (int k = 0; k < grid.dims[2]; ++k) {
    for (int j = 0; j < grid.dims[1]; ++j) {
      for (int i = 0; i < grid.dims[0]; ++i) {
        const Eigen::Vector3d p = (grid.X_PatientVoxel() * Point<Voxel>(i, j, k) - grid.centre()).eigen();
        labels->at(i, j, k) = inside(p + offset, -1) ? 1 : inside(p - offset, 1) ? 2 : 0;
      }
    }
  }
  return labels;
}

/// Along the rounded end of bone 2 in steps of 0.05 mm, from its tip outward.
std::vector<Point<Patient>> along_surface(const GridGeometry& grid, int count) {
  const Point<Patient> end = grid.centre() + Vector<Patient>(0, kBoneRadius + kGap / 2, 0);
  std::vector<Point<Patient>> points;
  double around = 0;
  for (int n = 0; n < count; ++n) {
    const double polar = 0.3 + 0.8 * n / count;
    around += 0.05 / (kBoneRadius * std::sin(polar));
    points.push_back(end + Vector<Patient>(std::sin(polar) * std::cos(around), -std::cos(polar),
                                           std::sin(polar) * std::sin(around)) *
                               kBoneRadius);
  }
  return points;
}

std::vector<Point<Patient>> anywhere(const GridGeometry& grid, int count) {
  std::mt19937 random(1);
  std::vector<Point<Patient>> points;
  for (int n = 0; n < count; ++n) {
    Point<Voxel> x;
    for (int axis = 0; axis < 3; ++axis) {
      x[axis] = std::uniform_real_distribution<double>(0, grid.dims[axis] - 1)(random);
    }
    points.push_back(grid.X_PatientVoxel() * x);
  }
  return points;
}

// ---- the contenders ---------------------------------------------------------------------------------------

using Points = std::shared_ptr<const std::vector<Point<Patient>>>;
using Samples = std::shared_ptr<std::vector<FieldSample>>;

std::vector<float> numbers_of(const std::vector<FieldSample>& samples) {
  std::vector<float> numbers;
  for (const FieldSample& sample : samples) {
    numbers.push_back(static_cast<float>(sample.value));
    for (int axis = 0; axis < 3; ++axis) numbers.push_back(static_cast<float>(sample.gradient[axis]));
  }
  return numbers;
}

/// Every query waits for the last one's result.
template <class Sample>
void one_after_another(const Sample& sample, const std::vector<Point<Patient>>& points,
                       std::vector<FieldSample>& samples) {
  Vector<Patient> wait;
  for (std::size_t n = 0; n < points.size(); ++n) {
    samples[n] = sample(points[n] + wait);
    wait = samples[n].gradient * 1e-30;
  }
}

enum class Form { kLiteral, kOne, kMany };

template <class Method>
Contender contender(std::string name, const std::shared_ptr<const Method>& method, const Points& points,
                    Form form) {
  const Samples samples = std::make_shared<std::vector<FieldSample>>(points->size());
  Contender entrant{std::move(name), 1, {}, [samples] { return numbers_of(*samples); }};
  if (form == Form::kLiteral) {
    entrant.work = [=] {
      one_after_another([&](const Point<Patient>& p) { return method->sample_literal(p); }, *points,
                        *samples);
    };
  } else if (form == Form::kOne) {
    entrant.work = [=] {
      one_after_another([&](const Point<Patient>& p) { return method->sample(p); }, *points, *samples);
    };
  } else {
    entrant.work = [=] { method->sample(*points, *samples); };
  }
  return entrant;
}

/// One way of storing one method, timed along the path and anywhere.
struct Row {
  std::string name;
  int bytes_per_voxel = 0;
  double literal_ns = 0, path_latency_ns = 0, path_batch_ns = 0, random_latency_ns = 0, random_batch_ns = 0;
  double ratio = 0;  ///< of the latencies along the path, vector form over literal
  double max_difference = 0;
};

/// Also says what the literal form gives, which everybody is compared with before times are taken.
template <class Method>
Row time_method(std::string name, int bytes_per_voxel, const Method& the_method, const Points& path,
                const Points& random, int rounds) {
  const auto method = std::make_shared<const Method>(the_method);
  Row row{std::move(name), bytes_per_voxel};
  for (const Points& points : {path, random}) {
    const std::vector<Contender> entrants{contender("literal", method, points, Form::kLiteral),
                                          contender("one", method, points, Form::kOne),
                                          contender("many", method, points, Form::kMany)};
    entrants[0].work();
    const auto timings = run_interleaved(entrants, entrants[0].result(), rounds);
    const auto ns = [&](int n) { return timings[n].median_ms * 1e6 / static_cast<double>(points->size()); };
    row.max_difference = std::max({row.max_difference, timings[1].max_difference, timings[2].max_difference});
    if (points == path) {
      row.literal_ns = ns(0);
      row.path_latency_ns = ns(1);
      row.path_batch_ns = ns(2);
      row.ratio = ns(1) / ns(0);
    } else {
      row.random_latency_ns = ns(1);
      row.random_batch_ns = ns(2);
    }
  }
  return row;
}

std::vector<Row> time_spheres(const std::shared_ptr<const Volume<LabelId>>& labels, const Options& options,
                              const Points& path, const Points& random) {
  std::vector<Row> rows;
  const LabelSet bones{1, 2}, apart{1, 2, 7};
  for (const auto& [suffix, voxels] : {std::pair("labels", LabelVoxels(labels, bones)),
                                       std::pair("labels, set of 2 runs", LabelVoxels(labels, apart)),
                                       std::pair("mask", LabelVoxels::mask(*labels, bones))}) {
    const auto time = [&](std::string name, const auto& sphere) {
      rows.push_back(time_method(std::move(name) + suffix, voxels.bytes_per_voxel(), sphere, path, random,
                                 options.rounds));
    };
    time("Gaussian sphere, sigma 1 voxel, ", GaussianSphere::make(voxels, 1).value());
    // so small a sigma that the radius is two voxels along every axis
    time("smooth sphere, 4x4x4, ", SmoothSphere::make(voxels, 0.1).value());
    const SmoothSphere full = SmoothSphere::make(voxels, options.sigma_mm).value();
    std::string size;
    for (const double radius : full.radius_voxels()) {
      size += (size.empty() ? "" : "x") + std::to_string(static_cast<int>(std::ceil(2 * radius)));
    }
    time("smooth sphere, " + size + ", ", full);
  }
  return rows;
}

struct Encoding {
  NormalEncoding encoding;
  const char* name;
};
constexpr Encoding kEncodings[] = {{NormalEncoding::kBytes, "3 bytes"},
                                   {NormalEncoding::kOctahedral16, "octahedral 16"},
                                   {NormalEncoding::kOctahedral24, "octahedral 24"}};

// ---- what stored normals lose -----------------------------------------------------------------------------

/// Angles in degrees between random directions and what is stored of them, and the founding work's flat
/// places: a ball of 100 mm radius around its top, the tilt of the stored normals beside the true one.
nlohmann::json normal_losses() {
  nlohmann::json losses;
  for (const auto& [encoding, name] : kEncodings) {
    std::mt19937 random(1);
    std::normal_distribution<double> normal;
    double sum = 0, most = 0;
    const int count = 100000;
    for (int n = 0; n < count; ++n) {
      const auto direction = Vector<Patient>(normal(random), normal(random), normal(random)).normalized();
      const auto stored = stored_normal(direction, encoding);
      const double degrees = std::asin(stored.cross(direction).norm()) * 180 / std::numbers::pi;
      sum += degrees;
      most = std::max(most, degrees);
    }
    losses[name] = {{"mean_degrees", sum / count},
                    {"max_degrees", most},
                    {"bytes_per_voxel", 1 + normal_bytes(encoding)}};
  }
  GridGeometry grid;
  grid.dims = {200, 1, 1};
  grid.spacing_mm = {0.05, 1, 1};
  grid.origin = Point<Patient>(0, 0, 100);
  for (const auto& [encoding, name] : kEncodings) {
    const auto normals = StoredNormals::from_field(grid, encoding, [](const Point<Patient>& p) {
      return FieldSample{0.5, -(p - Point<Patient>()).normalized()};
    });
    for (int i = 0; i < grid.dims[0]; ++i) {
      const auto degrees = [](double x, double z) { return std::atan2(x, z) * 180 / std::numbers::pi; };
      const Vector<Patient> inward = normals.voxel(i, 0, 0).gradient;
      losses[name]["stored_tilt_degrees"].push_back(degrees(-inward.x(), -inward.z()));
      losses[name]["true_tilt_degrees"].push_back(degrees(0.05 * i, 100));
    }
    auto tilts = losses[name]["stored_tilt_degrees"].get<std::vector<double>>();
    losses[name]["distinct_tilts"] = std::unique(tilts.begin(), tilts.end()) - tilts.begin();
  }
  return losses;
}

// ---- what is shown ----------------------------------------------------------------------------------------

void print_rows(const std::vector<Row>& rows) {
  std::printf("\n%-50s %6s %10s %9s %9s %9s %9s %7s %9s\n", "ns a query; medians", "bytes/", "literal",
              "surface", "surface", "random", "random", "ratio", "max");
  std::printf("%-50s %6s %10s %9s %9s %9s %9s %7s %9s\n", "", "voxel", "latency", "latency", "batch",
              "latency", "batch", "", "diff");
  for (const Row& row : rows) {
    std::printf("%-50s %6d %10.1f %9.1f %9.1f %9.1f %9.1f %7.4f %9.1e\n", row.name.c_str(),
                row.bytes_per_voxel, row.literal_ns, row.path_latency_ns, row.path_batch_ns,
                row.random_latency_ns, row.random_batch_ns, row.ratio, row.max_difference);
  }
}

nlohmann::json to_json(const std::vector<Row>& rows) {
  nlohmann::json all = nlohmann::json::array();
  for (const Row& row : rows) {
    all.push_back({{"name", row.name},
                   {"bytes_per_voxel", row.bytes_per_voxel},
                   {"literal_latency_ns", row.literal_ns},
                   {"surface_latency_ns", row.path_latency_ns},
                   {"surface_batch_ns", row.path_batch_ns},
                   {"random_latency_ns", row.random_latency_ns},
                   {"random_batch_ns", row.random_batch_ns},
                   {"ratio", row.ratio},
                   {"max_difference", row.max_difference}});
  }
  return all;
}

int run(const Options& options) {
  const auto labels = two_bones();
  const GridGeometry& grid = labels->geometry();
  const auto path = std::make_shared<const std::vector<Point<Patient>>>(along_surface(grid, options.points));
  const auto random = std::make_shared<const std::vector<Point<Patient>>>(anywhere(grid, options.points));

  auto rows = time_spheres(labels, options, path, random);
  Volume<std::uint8_t> felt(grid);
  std::transform(labels->voxels().begin(), labels->voxels().end(), felt.voxels().begin(),
                 [](LabelId label) { return static_cast<std::uint8_t>(label != 0 ? 255 : 0); });
  const auto ramp = gaussian_smooth_16(felt, {.sigma_mm = options.sigma_mm}).value();
  std::size_t occupied = 0;
  for (const auto& [encoding, name] : kEncodings) {
    const auto normals = StoredNormals::from_ramp(ramp, encoding);
    occupied = normals.occupied_voxels();
    rows.push_back(time_method(std::string("stored normals, ") + name, normals.bytes_per_voxel(), normals,
                               path, random, options.rounds));
  }
  const nlohmann::json losses = normal_losses();

  std::printf(
      "two bones 3 mm apart, 256x256x124, 0.625x0.625x0.9 mm; sigma %g mm, %d interleaved rounds, SIMD "
      "target %s\n",
      options.sigma_mm, options.rounds, simd_targets().front().c_str());
  print_rows(rows);
  std::printf("\nstored normals: %zu of %zu voxels occupied\n", occupied, grid.voxel_count());
  for (const auto& [encoding, name] : kEncodings) {
    const auto& loss = losses[name];
    std::printf(
        "%-16s %d bytes a voxel, error %.4f degrees mean, %.4f max; %d tilts for 200 voxels near an axis\n",
        name, loss["bytes_per_voxel"].get<int>(), loss["mean_degrees"].get<double>(),
        loss["max_degrees"].get<double>(), loss["distinct_tilts"].get<int>());
  }
  if (options.json.empty()) return 0;
  std::ofstream file(options.json);
  file << nlohmann::json{{"sigma_mm", options.sigma_mm},
                         {"rounds", options.rounds},
                         {"simd_target", simd_targets().front()},
                         {"rows", to_json(rows)},
                         {"voxels", grid.voxel_count()},
                         {"occupied_voxels", occupied},
                         {"stored_normals", losses}}
              .dump(2)
       << '\n';
  file.close();
  if (file) return 0;
  std::fprintf(stderr, "label_methods_bench: %s could not be written\n", options.json.c_str());
  return 4;
}

}  // namespace

}  // namespace palpate::bench

int main(int argc, char** argv) {
  palpate::bench::Options options;
  CLI::App app("The force methods on labels and stored normals: literal and vector forms in one run");
  app.add_option("--sigma", options.sigma_mm, "width of the full smooth sphere and of the ramp in mm")
      ->check(CLI::Range(0.5, 4.0))
      ->capture_default_str();
  app.add_option("--rounds", options.rounds, "interleaved rounds")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--points", options.points, "points on the path, and random ones")
      ->check(CLI::Range(100, 1000000))
      ->capture_default_str();
  app.add_option("--json", options.json, "write the figures to this file");
  CLI11_PARSE(app, argc, argv);
  return palpate::bench::run(options);
}
