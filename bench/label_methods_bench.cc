// Force methods on raw labels and stored normals: scalar and vectorised implementations in one run. See
// README.md.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "interleaved.h"
#include "json_file.h"
#include "palpate/preparation/preparation.h"
#include "palpate/sampling/sphere_filters.h"
#include "palpate/sampling/stored_normals.h"
#include "palpate/volume/simd_targets.h"
#include "work.h"

namespace palpate::bench {

namespace {

struct Options {
  double sigma_mm = 1.5;
  int rounds = 9;
  std::size_t points = 4000;
  std::string json;
};

// ---- workload ---------------------------------------------------------------------------------------------

/// Volume with labels 1 and 2.
Volume<LabelId> labelled(const Volume<std::uint8_t>& bones) {
  const GridGeometry& grid = bones.geometry();
  Volume<LabelId> labels(grid);
  for (int k = 0; k < grid.dims[2]; ++k) {
    for (int j = 0; j < grid.dims[1]; ++j) {
      const LabelId bone = j < grid.dims[1] / 2 ? 1 : 2;
      for (int i = 0; i < grid.dims[0]; ++i) labels.at(i, j, k) = bones.at(i, j, k) > 0 ? bone : 0;
    }
  }
  return labels;
}

// ---- contenders -------------------------------------------------------------------------------------------

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

/// Dependent queries: each waits for the result of the previous one.
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

/// One storage format of a method, timed along the path and at random points.
struct Row {
  std::string name;
  int bytes_per_voxel = 0;
  double literal_ns = 0, path_latency_ns = 0, path_batch_ns = 0, random_latency_ns = 0, random_batch_ns = 0;
  double ratio = 0;  ///< Ratio of the latencies along the path, vectorised to scalar
  double max_difference = 0;
};

/// Also computes the result of the scalar implementation, the reference of the others, before timing.
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

std::vector<Row> time_spheres(const std::shared_ptr<const Bricks<LabelId>>& labels, const Options& options,
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
    // a small sigma, so that the radius is two voxels along every axis
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

// ---- memory -----------------------------------------------------------------------------------------------

struct Memory {
  std::string name;
  int bytes_per_voxel = 0;
  std::size_t voxels = 0;
  std::size_t occupied = 0;  ///< Number of non-zero voxels
  /// Size of the voxels without the border that some formats add.
  double dense_MB() const { return 1e-6 * bytes_per_voxel * static_cast<double>(voxels); }
  double occupied_MB() const { return 1e-6 * bytes_per_voxel * static_cast<double>(occupied); }
};

template <class T>
Memory memory_of(std::string name, int bytes_per_voxel, const Volume<T>& volume) {
  const auto& voxels = volume.voxels();
  const auto empty = static_cast<std::size_t>(std::count(voxels.begin(), voxels.end(), T{0}));
  return {std::move(name), bytes_per_voxel, voxels.size(), voxels.size() - empty};
}

/// Prepared representations of the bones, and their inputs.
struct Prepared {
  explicit Prepared(const Options& options)
      : bones(two_bones()),
        labels(labelled(bones)),
        ramp_8(gaussian_smooth(bones, {.sigma_mm = options.sigma_mm}).value()),
        ramp_16(gaussian_smooth_16(bones, {.sigma_mm = options.sigma_mm}).value()) {}
  Volume<std::uint8_t> bones;
  Volume<LabelId> labels;
  Volume<std::uint8_t> ramp_8;
  Volume<std::uint16_t> ramp_16;
};

std::vector<Memory> memory_of_all(const Prepared& prepared) {
  const SplineField spline{Field(prepared.ramp_16)};
  const auto& coefficients = *std::get_if<Bricks<std::int16_t>>(&spline.coefficients());
  std::vector<Memory> all = {memory_of("trilinear, uint8", 1, prepared.ramp_8),
                             memory_of("trilinear, uint16", 2, prepared.ramp_16),
                             memory_of("B-spline, int16", spline.bytes_per_voxel(), coefficients.dense()),
                             memory_of("Gaussian and smooth sphere, labels (shared)", 2, prepared.labels),
                             memory_of("Gaussian and smooth sphere, mask", 1, prepared.bones)};
  for (const auto& [encoding, name] : kEncodings) {
    const auto normals = StoredNormals::from_ramp(prepared.ramp_16, encoding);
    all.push_back({std::string("stored normals, ") + name, normals.bytes_per_voxel(),
                   normals.geometry().voxel_count(), normals.occupied_voxels()});
  }
  return all;
}

// ---- output -----------------------------------------------------------------------------------------------

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

void print_memory(const std::vector<Memory>& all) {
  std::printf("\n%-50s %6s %10s %10s %10s\n", "memory; MB: 10^6 bytes, voxels alone", "bytes/", "occupied",
              "MB", "MB of");
  std::printf("%-50s %6s %10s %10s %10s\n", "", "voxel", "voxels", "", "occupied");
  for (const Memory& memory : all) {
    std::printf("%-50s %6d %10zu %10.1f %10.1f\n", memory.name.c_str(), memory.bytes_per_voxel,
                memory.occupied, memory.dense_MB(), memory.occupied_MB());
  }
}

nlohmann::json to_json(const std::vector<Memory>& memories) {
  nlohmann::json all = nlohmann::json::array();
  for (const Memory& memory : memories) {
    all.push_back({{"name", memory.name},
                   {"bytes_per_voxel", memory.bytes_per_voxel},
                   {"occupied_voxels", memory.occupied},
                   {"MB", memory.dense_MB()},
                   {"occupied_MB", memory.occupied_MB()}});
  }
  return all;
}

int run(const Options& options) {
  const Prepared prepared(options);
  const Points path = std::make_shared<const std::vector<Point<Patient>>>(probe_path(options.points));
  const Points random = std::make_shared<const std::vector<Point<Patient>>>(random_points(options.points, 0));

  auto rows = time_spheres(label_bricks(prepared.labels), options, path, random);
  for (const auto& [encoding, name] : kEncodings) {
    const auto normals = StoredNormals::from_ramp(prepared.ramp_16, encoding);
    rows.push_back(time_method(std::string("stored normals, ") + name, normals.bytes_per_voxel(), normals,
                               path, random, options.rounds));
  }
  const auto memory = memory_of_all(prepared);

  std::printf(
      "two bones 3 mm apart, 256x256x124, 0.625x0.625x0.9 mm; sigma %g mm, %d interleaved rounds, SIMD "
      "target %s\n",
      options.sigma_mm, options.rounds, simd_targets().front().c_str());
  print_rows(rows);
  print_memory(memory);
  return write_json("label_methods_bench", options.json,
                    {{"sigma_mm", options.sigma_mm},
                     {"rounds", options.rounds},
                     {"simd_target", simd_targets().front()},
                     {"rows", to_json(rows)},
                     {"voxels", prepared.bones.voxels().size()},
                     {"memory", to_json(memory)}});
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
