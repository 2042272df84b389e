// Gaussian smoothing: palpate and ITK on the same volumes in one run. See README.md.

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <random>

#include "interleaved.h"
#include "itk_gaussian.h"
#include "json_file.h"
#include "palpate/preparation/preparation.h"
#include "palpate/volume/simd_targets.h"
#include "palpate/volume_io/volume_io.h"
#include "work.h"

namespace palpate::bench {

namespace {

struct Options {
  double sigma_mm = 1.5;
  int rounds = 9;
  std::string labels, json;
};

struct Work {
  std::string title;
  Volume<std::uint8_t> volume;
};

Work bones() {
  return {"two bones 3 mm apart, 256x256x124, 0.625x0.625x0.9 mm", two_bones()};
}

/// Noise without any empty row that could be skipped.
Work full_of_noise() {
  Volume<std::uint8_t> volume(founding_grid());
  std::mt19937 random(1);
  for (auto& voxel : volume.voxels()) voxel = static_cast<std::uint8_t>(random());
  return {"random bytes everywhere, 256x256x124, 0.625x0.625x0.9 mm", std::move(volume)};
}

Result<Work> labels_of_file(const std::string& file) {
  const auto read = read_labels(file);
  if (!read) return read.error();
  std::vector<std::uint8_t> weights(std::size_t{1} << 16, 255);
  weights[0] = 0;
  const auto& dims = read->header.geometry.dims;
  std::string title = "all labels of the file given, " + std::to_string(dims[0]) + "x" +
                      std::to_string(dims[1]) + "x" + std::to_string(dims[2]);
  return Work{std::move(title), weigh_labels(read->labels.flattened(), weights)};
}

/// Voxels farther from the boundary than the reach of the kernel: outside a volume palpate assumes 0 and ITK
/// repeats the boundary, which is not a difference of accuracy.
class Interior {
 public:
  Interior(const GridGeometry& grid, double sigma_mm) : grid_(grid) {
    for (int axis = 0; axis < 3; ++axis) {
      margin_[axis] = static_cast<int>(std::ceil(4 * sigma_mm / grid.spacing_mm[axis]));
    }
  }
  template <class T>
  std::vector<float> of(const T* voxels, float unit) const {
    std::vector<float> values;
    for (int k = margin_[2]; k < grid_.dims[2] - margin_[2]; ++k) {
      for (int j = margin_[1]; j < grid_.dims[1] - margin_[1]; ++j) {
        for (int i = margin_[0]; i < grid_.dims[0] - margin_[0]; ++i) {
          values.push_back(static_cast<float>(voxels[grid_.offset(i, j, k)]) / unit);
        }
      }
    }
    return values;
  }

 private:
  GridGeometry grid_;
  std::array<int, 3> margin_{};
};

template <class Out, class Smooth>
Contender ours(std::string name, int threads, const Smooth& smooth, const Interior& interior, float unit) {
  const auto stored = std::make_shared<Volume<Out>>();
  return {std::move(name), threads, [=] { *stored = smooth().value(); },
          [=] { return interior.of(stored->voxels().data(), unit); }};
}

std::vector<Contender> contenders(const Work& work, double sigma_mm) {
  std::vector<Contender> all;
  const auto& volume = work.volume;
  const Interior interior(volume.geometry(), sigma_mm);
  for (const int threads : {1, 2}) {
    const GaussianOptions direct{.sigma_mm = sigma_mm, .engine = GaussianEngine::kDirect, .threads = threads};
    GaussianOptions fourier = direct;
    fourier.engine = GaussianEngine::kFourier;
    all.push_back(ours<std::uint8_t>(
        "palpate direct, 8 to 8 bits", threads, [=, &volume] { return gaussian_smooth(volume, direct); },
        interior, 1));
    all.push_back(ours<std::uint16_t>(
        "palpate direct, 8 to 16 bits", threads, [=, &volume] { return gaussian_smooth_16(volume, direct); },
        interior, 257));
    all.push_back(ours<std::uint16_t>(
        "palpate Fourier, 8 to 16 bits", threads,
        [=, &volume] { return gaussian_smooth_16(volume, fourier); }, interior, 257));
  }
  const auto itk = std::make_shared<ItkGaussian>(volume);
  const auto result = [=] { return interior.of(itk->result(), 1); };
  for (const int threads : {1, 2}) {
    all.push_back({"ITK SmoothingRecursiveGaussian", threads,
                   [=] { itk->smooth_recursive(sigma_mm, threads); }, result});
    all.push_back(
        {"ITK DiscreteGaussian", threads, [=] { itk->smooth_discrete(sigma_mm, threads); }, result});
  }
  return all;
}

nlohmann::json to_json(const Work& work, const std::vector<Timing>& timings) {
  nlohmann::json rows = nlohmann::json::array();
  for (const Timing& t : timings) {
    rows.push_back({{"name", t.name},
                    {"threads", t.threads},
                    {"median_ms", t.median_ms},
                    {"fastest_ms", t.fastest_ms},
                    {"slowest_ms", t.slowest_ms},
                    {"ratio", t.ratio},
                    {"max_difference", t.max_difference},
                    {"mean_difference", t.mean_difference}});
  }
  return {{"work", work.title}, {"rows", rows}};
}

int run(const Options& options) {
  std::vector<Work> works;
  works.push_back(bones());
  works.push_back(full_of_noise());
  if (!options.labels.empty()) {
    auto work = labels_of_file(options.labels);
    if (!work) {
      std::fprintf(stderr, "gaussian_bench: %s\n", work.error().message().c_str());
      return 1;
    }
    works.push_back(*std::move(work));
  }

  std::printf("sigma %g mm, %d interleaved rounds, SIMD target %s\n", options.sigma_mm, options.rounds,
              simd_targets().front().c_str());
  std::printf(
      "ratio: to the first row with as many threads; differences: of 255, from the direct 16-bit result\n");
  nlohmann::json all = nlohmann::json::array();
  for (const Work& work : works) {
    const auto entrants = contenders(work, options.sigma_mm);
    entrants[1].work();
    const auto timings = run_interleaved(entrants, entrants[1].result(), options.rounds);
    print_table(work.title, timings);
    all.push_back(to_json(work, timings));
  }
  return write_json("gaussian_bench", options.json,
                    {{"sigma_mm", options.sigma_mm},
                     {"rounds", options.rounds},
                     {"simd_target", simd_targets().front()},
                     {"works", all}});
}

}  // namespace

}  // namespace palpate::bench

int main(int argc, char** argv) {
  palpate::bench::Options options;
  CLI::App app("Gaussian smoothing: palpate and ITK on the same volumes in one run");
  app.add_option("--sigma", options.sigma_mm, "width in mm")
      ->check(CLI::Range(0.1, 10.0))
      ->capture_default_str();
  app.add_option("--rounds", options.rounds, "interleaved rounds")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--labels", options.labels, "also smooth all labels of this file");
  app.add_option("--json", options.json, "write the figures to this file");
  CLI11_PARSE(app, argc, argv);
  return palpate::bench::run(options);
}
