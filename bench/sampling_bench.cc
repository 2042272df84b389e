// Value and gradient at a point: palpate, plain code and other libraries on the same field in one run. See
// README.md.

#include <hwy/targets.h>

#include <CLI/CLI.hpp>
#include <cstdio>

#include "entrant.h"
#include "interleaved.h"
#include "json_file.h"
#include "palpate/preparation/preparation.h"
#include "palpate/volume/simd_targets.h"
#include "work.h"

namespace palpate::bench {

namespace {

struct Options {
  std::size_t points = 5'000;
  int rounds = 41;
  std::string json;
};

constexpr double kSigma_mm = 1.5;
/// Maximum difference from the plain code, in units of full scale; for gradients per mm.
constexpr double kTolerance = 1e-4;
/// Minimum distance of random points from the boundary, voxels; ITK's spline treats the boundary differently.
constexpr double kMargin = 10;
constexpr int kWarmingPasses = 3;

// ---- entrants ---------------------------------------------------------------------------------------

/// Restricts Highway to one target while an entrant runs.
Entrant on_target(std::int64_t target, Entrant entrant) {
  const auto wrapped = [target](std::function<void(Points, Samples)> run) {
    if (!run) return run;
    return std::function<void(Points, Samples)>(
        [target, run = std::move(run)](Points points, Samples samples) {
          hwy::SetSupportedTargetsForTest(target);
          hwy::GetChosenTarget().Update(target);
          run(points, samples);
          hwy::SetSupportedTargetsForTest(0);
          hwy::GetChosenTarget().DeInit();
        });
  };
  entrant.name += std::string(", ") + hwy::TargetName(target);
  entrant.throughput = wrapped(std::move(entrant.throughput));
  entrant.latency = wrapped(std::move(entrant.latency));
  return entrant;
}

template <class AnyField>
Entrant one_by_one(const std::string& storage, const AnyField& field) {
  return entrant("palpate, " + storage,
                 [&field](const Point<Patient>& p) { return sample_central_differences(field, p); });
}

template <class AnyField>
Entrant many(const std::string& storage, const AnyField& field) {
  Entrant result;
  result.name = "palpate, many points, " + storage;
  result.throughput = [&field](Points points, Samples samples) {
    sample_central_differences(field, points, samples);
  };
  return result;
}

/// The same field in each storage format.
struct Fields {
  explicit Fields(const Volume<std::uint8_t>& volume)
      : bytes(volume),
        words(scaled<std::uint16_t>(volume, 257)),
        signed_words(scaled<std::int16_t>(volume, 128), {.scale = 1.0 / (255 * 128)}),
        spline(bytes, {.storage = SplineStorage::kInt16}),
        spline_of_floats(bytes, {.storage = SplineStorage::kFloat}) {}

  template <class T>
  static Volume<T> scaled(const Volume<std::uint8_t>& volume, int factor) {
    Volume<T> result(volume.geometry());
    for (std::size_t n = 0; n < volume.voxels().size(); ++n) {
      result.voxels()[n] = static_cast<T>(factor * volume.voxels()[n]);
    }
    return result;
  }

  Field bytes, words;
  SignedField signed_words;
  SplineField spline, spline_of_floats;
};

std::vector<Entrant> trilinear_entrants(const std::shared_ptr<const SampledWork>& work,
                                        const Fields& fields) {
  std::vector<Entrant> all = plain_entrants(work);
  const auto add = [&](const std::vector<Entrant>& more) { all.insert(all.end(), more.begin(), more.end()); };
  add({loads_only(work), one_by_one("uint8", fields.bytes), one_by_one("uint16", fields.words),
       one_by_one("int16", fields.signed_words), many("uint8", fields.bytes), many("uint16", fields.words),
       many("int16", fields.signed_words)});
  const auto targets = hwy::SupportedAndGeneratedTargets();
  for (std::size_t t = 1; t < targets.size(); ++t) {
    add({on_target(targets[t], one_by_one("uint8", fields.bytes)),
         on_target(targets[t], many("uint8", fields.bytes))});
  }
  add(itk_entrants(work));
  add(vtk_entrants(work));
  add(vdb_entrants(work));
  return all;
}

std::vector<Entrant> spline_entrants(const std::shared_ptr<const SampledWork>& work, const Fields& fields) {
  const auto ours = [](const std::string& storage, const SplineField& field) {
    return entrant("palpate spline, " + storage,
                   [&field](const Point<Patient>& p) { return sample_spline(field, p); });
  };
  Entrant together;
  together.name = "palpate spline, many points, int16";
  together.throughput = [&](Points points, Samples samples) {
    sample_spline(fields.spline, points, samples);
  };

  std::vector<Entrant> all = plain_splines(fields.spline);
  for (const Entrant& entrant :
       {ours("int16", fields.spline), ours("float", fields.spline_of_floats), together}) {
    all.push_back(entrant);
  }
  const auto targets = hwy::SupportedAndGeneratedTargets();
  for (std::size_t t = 1; t < targets.size(); ++t) {
    all.push_back(on_target(targets[t], ours("int16", fields.spline)));
  }
  all.push_back(itk_spline(work));
  return all;
}

// ---- measurement --------------------------------------------------------------------------------------

std::vector<float> flattened(const std::vector<FieldSample>& samples) {
  std::vector<float> numbers;
  for (const FieldSample& s : samples) {
    for (const double x : {s.value, s.gradient.x(), s.gradient.y(), s.gradient.z()}) {
      numbers.push_back(static_cast<float>(x));
    }
  }
  return numbers;
}

/// Values of a run, with those that are not compared replaced by the reference's.
std::vector<float> compared(const std::vector<FieldSample>& samples, Compared what,
                            const std::vector<float>& reference) {
  if (what == Compared::kAll) return flattened(samples);
  std::vector<float> numbers = reference;
  if (what == Compared::kValue) {
    for (std::size_t n = 0; n < samples.size(); ++n) numbers[4 * n] = static_cast<float>(samples[n].value);
  }
  return numbers;
}

/// A row of the table, in ns per query; 0 if not measured.
struct Row {
  std::string name;
  Compared compared = Compared::kAll;
  double max_difference = 0;
  std::array<double, 4> ns{};
};
constexpr const char* kColumns[4] = {"probe THR", "probe LAT", "random THR", "random LAT"};

std::vector<Row> measure(const std::vector<Entrant>& entrants, const Options& options) {
  std::vector<Row> rows;
  for (const Entrant& entrant : entrants)
    rows.push_back({.name = entrant.name, .compared = entrant.compared});
  for (std::size_t column = 0; column < 4; ++column) {
    const auto points = column < 2 ? probe_path(options.points) : random_points(options.points, kMargin);
    std::vector<FieldSample> samples(points.size());
    entrants.front().throughput(points, samples);
    const auto reference = flattened(samples);

    std::vector<Contender> contenders;
    std::vector<std::size_t> row_of;
    for (std::size_t e = 0; e < entrants.size(); ++e) {
      const auto& run = column % 2 == 0 ? entrants[e].throughput : entrants[e].latency;
      if (!run) continue;
      row_of.push_back(e);
      // short enough to fit into a scheduler time slice, with voxels in the caches: replacing another
      // entrant's voxels takes more than one pass
      const auto pass = [&] { run(points, samples); };
      const auto warm_up = [pass] {
        for (int n = 0; n < kWarmingPasses; ++n) pass();
      };
      contenders.push_back({entrants[e].name, 1, pass,
                            [&, e] { return compared(samples, entrants[e].compared, reference); }, warm_up});
    }
    const auto timings = run_interleaved(contenders, reference, options.rounds);
    for (std::size_t n = 0; n < timings.size(); ++n) {
      Row& row = rows[row_of[n]];
      row.ns[column] = timings[n].median_ms * 1e6 / static_cast<double>(points.size());
      row.max_difference = std::max(row.max_difference, timings[n].max_difference);
    }
  }
  return rows;
}

void print_rows(const std::string& title, const std::vector<Row>& rows) {
  std::printf("\n%s\n%-44s", title.c_str(), "ns a query");
  for (const char* column : kColumns) std::printf(" %11s", column);
  std::printf(" %9s %10s\n", "LAT ratio", "max diff");
  for (const Row& row : rows) {
    std::printf("%-44s", row.name.c_str());
    for (const double ns : row.ns) ns > 0 ? std::printf(" %11.1f", ns) : std::printf(" %11s", "-");
    row.ns[1] > 0 ? std::printf(" %9.2f", row.ns[1] / rows.front().ns[1]) : std::printf(" %9s", "-");
    row.compared == Compared::kNothing ? std::printf(" %10s\n", "-")
                                       : std::printf(" %10.1e\n", row.max_difference);
  }
}

nlohmann::json to_json(const std::string& title, const std::vector<Row>& rows) {
  nlohmann::json list = nlohmann::json::array();
  for (const Row& row : rows) {
    nlohmann::json entry = {{"name", row.name}};
    if (row.compared != Compared::kNothing) entry["max_difference"] = row.max_difference;
    for (std::size_t column = 0; column < 4; ++column) {
      if (row.ns[column] > 0) entry["ns"][kColumns[column]] = row.ns[column];
    }
    list.push_back(std::move(entry));
  }
  return {{"title", title}, {"rows", std::move(list)}};
}

/// Whether palpate's rows agree with the plain code.
bool all_agree(const std::vector<Row>& rows) {
  bool agree = true;
  for (const Row& row : rows) {
    if (!row.name.starts_with("palpate") || row.max_difference <= kTolerance) continue;
    std::fprintf(stderr, "sampling_bench: %s differs by %g\n", row.name.c_str(), row.max_difference);
    agree = false;
  }
  return agree;
}

int run(const Options& options) {
  const auto bytes = gaussian_smooth(two_bones(), {.sigma_mm = kSigma_mm, .threads = 1}).value();
  const Fields fields(bytes);
  const auto work = std::make_shared<const SampledWork>(
      SampledWork{bytes, fields.bytes.X_VoxelPatient(), fields.bytes.gradient_map()});

  std::printf(
      "two bones 3 mm apart, 256x256x124, 0.625x0.625x0.9 mm, sigma %g mm; %zu points, %d interleaved "
      "rounds\n",
      kSigma_mm, options.points, options.rounds);
  std::printf("SIMD target %s; THR: independent queries, LAT: each waits for the last\n",
              simd_targets().front().c_str());
  std::printf(
      "LAT ratio: of probe LAT to the first row; max diff: from the first row, of full scale (per mm)\n");

  bool agree = true;
  nlohmann::json tables = nlohmann::json::array();
  const auto table = [&](const std::string& title, const std::vector<Entrant>& entrants) {
    const auto rows = measure(entrants, options);
    print_rows(title, rows);
    tables.push_back(to_json(title, rows));
    agree = all_agree(rows) && agree;
  };
  table("Trilinear value and central differences", trilinear_entrants(work, fields));
  table("Cubic B-spline value and gradient", spline_entrants(work, fields));
  if (!agree) return 1;

  return write_json("sampling_bench", options.json,
                    {{"points", options.points},
                     {"rounds", options.rounds},
                     {"simd_target", simd_targets().front()},
                     {"tables", tables}});
}

}  // namespace

}  // namespace palpate::bench

int main(int argc, char** argv) {
  palpate::bench::Options options;
  CLI::App app(
      "Value and gradient at a point: palpate, plain code, ITK, VTK, OpenVDB and NanoVDB on one field");
  app.add_option("--points", options.points, "points of each path")
      ->check(CLI::Range(1000, 10'000'000))
      ->capture_default_str();
  app.add_option("--rounds", options.rounds, "interleaved rounds")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--json", options.json, "write the figures to this file");
  CLI11_PARSE(app, argc, argv);
  return palpate::bench::run(options);
}
