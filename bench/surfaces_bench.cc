// Preparation of surfaces from labels: whole structures, and the update of a box of 32^3 voxels. See
// README.md.

#include <sys/resource.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <random>

#include "json_file.h"
#include "large_knee.h"
#include "palpate/phantoms/primitives.h"
#include "palpate/surfaces/surfaces.h"
#include "palpate/volume_io/volume_io.h"

namespace palpate::bench {

namespace {

constexpr std::size_t kStructures = 8;
constexpr int kDirty = 32;

struct Options {
  int rounds = 41, threads = 0;
  std::string labels, json;
};

double now_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

double peak_MB() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024;
}

// for a knee its bones, cartilages and menisci, otherwise the largest structures
std::vector<Segment> choose(const LabelMap& labels) {
  std::vector<Segment> chosen;
  for (const char* name : {"femur", "tibia", "patella", "femoral_cartilage", "lateral_tibial_cartilage",
                           "medial_tibial_cartilage", "lateral_meniscus", "medial_meniscus"}) {
    if (const Segment* s = labels.find(std::string(name))) chosen.push_back(*s);
  }
  if (chosen.size() == kStructures) return chosen;
  auto statistics = segment_statistics(labels);
  std::sort(statistics.begin(), statistics.end(),
            [](const auto& a, const auto& b) { return a.voxels > b.voxels; });
  chosen.clear();
  for (const auto& s : statistics) {
    const Segment* segment = labels.find(s.id);
    if (segment->layer == 0 && chosen.size() < kStructures) chosen.push_back(*segment);
  }
  return chosen;
}

// a box around a random voxel at the structure's boundary, with a ball of tissue removed
PatchOf<LabelId> dig(const PreparedSurface& surface, std::mt19937& random, const Bricks<LabelId>& labels) {
  const GridGeometry& grid = labels.geometry();
  const auto& box = surface.intermediates.extent;
  for (;;) {
    std::array<int, 3> at;
    for (int a = 0; a < 3; ++a) {
      at[a] = std::uniform_int_distribution<int>(box.first[a], box.first[a] + box.size[a] - 1)(random);
    }
    const auto label = [&](int i) { return labels.anywhere(at[0] + i, at[1], at[2]); };
    if (label(0) != surface.label || (label(1) == surface.label && label(-1) == surface.label)) continue;
    PatchOf<LabelId> dug;
    for (std::size_t a = 0; a < 3; ++a) {
      const int low = std::max(0, at[a] - kDirty / 2), high = std::min(grid.dims[a], at[a] + kDirty / 2);
      dug.box.first[a] = low;
      dug.box.size[a] = high - low;
    }
    const auto& [first, size] = dug.box;
    for (int k = first[2]; k < first[2] + size[2]; ++k) {
      for (int j = first[1]; j < first[1] + size[1]; ++j) {
        for (int i = first[0]; i < first[0] + size[0]; ++i) {
          const double r = std::hypot(i - at[0], j - at[1], k - at[2]);
          const LabelId voxel = labels.at(i, j, k);
          dug.values.push_back(voxel == surface.label && r < kDirty / 2.0 ? LabelId{0} : voxel);
        }
      }
    }
    return dug;
  }
}

/// Memory used for contact and that needed for updates, without the net.
double bytes_of(const PreparedSurface& surface) {
  std::size_t bytes = surface.intermediates.slopes.size() * sizeof(float);
  for (const Bricks<std::int16_t>* bricks :
       {&surface.surface.distance_field().bricks(), &surface.surface.normal_field().bricks(),
        &surface.intermediates.distance, &surface.intermediates.broad})
    bytes += bricks->bytes();
  return static_cast<double>(bytes);
}

Result<nlohmann::json> run(const Options& options) {
  std::string what;
  auto map = large_knee(options.labels, what);
  if (!map) return map.error();
  const std::vector<Segment> segments = choose(*map);
  const std::shared_ptr<const Bricks<LabelId>> shared_labels = label_bricks(map->layers.front());
  const Bricks<LabelId>& labels = *shared_labels;
  map->layers.clear();
  const double loaded_MB = peak_MB();
  std::vector<LabelId> structures;
  for (const Segment& s : segments) structures.push_back(s.value);

  SurfaceOptions surface_options;
  surface_options.threads = options.threads;
  const double start = now_s();
  const auto prepared = prepare_surfaces(labels, structures, surface_options);
  const double all_s = now_s() - start;
  if (!prepared) return prepared.error();
  const GridGeometry& grid = labels.geometry();
  std::printf("%s, %zu structures of %dx%dx%d voxels: %.2f s, peak %.0f MB (%.0f MB before)\n", what.c_str(),
              structures.size(), grid.dims[0], grid.dims[1], grid.dims[2], all_s, peak_MB(), loaded_MB);

  nlohmann::json report{{"structures_s", all_s}, {"peak_MB", peak_MB()}, {"voxels", grid.voxel_count()}};
  std::printf("labels in bricks: %.1f MB of %.1f\n", static_cast<double>(labels.bytes()) / 1e6,
              static_cast<double>(grid.voxel_count() * sizeof(LabelId)) / 1e6);
  report["labels_MB"] = static_cast<double>(labels.bytes()) / 1e6;
  std::printf("%-28s %9s %9s %12s %14s %14s %14s\n", "", "M voxels", "MB", "steepest", "patch, ms",
              "version, ms", "labels, ms");
  std::mt19937 random(1);
  for (std::size_t n = 0; n < prepared->size(); ++n) {
    const PreparedSurface& surface = (*prepared)[n];
    // timed separately, because each affects the caches and the heap of the other
    std::vector<double> patch_ms, again_ms, labels_ms;
    for (const bool whole : {false, true}) {
      for (int round = 0; round < options.rounds; ++round) {
        const PatchOf<LabelId> dug = dig(surface, random, labels);
        const double begin = now_s();
        const Bricks<LabelId> version = labels.with(dug);
        const double t = now_s();
        const bool local = whole ? update_surface(surface, version, dug.box).ok()
                                 : prepare_patch(surface, version, dug.box).is_applicable;
        const double ms = 1e3 * (now_s() - t);
        labels_ms.push_back(1e3 * (t - begin));
        if (local) (whole ? again_ms : patch_ms).push_back(ms);
      }
    }
    if (patch_ms.empty() || again_ms.empty()) continue;
    const double MB = bytes_of(surface) / 1e6;
    std::printf("%-28s %9.1f %9.1f %12.2f %14.2f %14.2f %14.2f\n", segments[n].name.c_str(),
                static_cast<double>(surface.intermediates.distance.geometry().voxel_count()) / 1e6, MB,
                surface.surface.max_gradient(), median(patch_ms), median(again_ms), median(labels_ms));
    report["dirty_ms"][segments[n].name] = {
        {"patch", median(patch_ms)}, {"version", median(again_ms)}, {"labels", median(labels_ms)}};
    report["MB"][segments[n].name] = MB;
  }
  return report;
}

}  // namespace

}  // namespace palpate::bench

int main(int argc, char** argv) {
  palpate::bench::Options options;
  CLI::App app{"Preparing surfaces from labels"};
  app.add_option("--labels", options.labels,
                 "A label map; default: the knee of PALPATE_DATA, or a generated one");
  app.add_option("--rounds", options.rounds, "Dirty boxes for each structure")->check(CLI::Range(1, 1000));
  app.add_option("--threads", options.threads, "0: as many as the machine has")->check(CLI::Range(0, 256));
  app.add_option("--json", options.json, "Writes the figures to this file");
  CLI11_PARSE(app, argc, argv);
  const auto figures = palpate::bench::run(options);
  if (figures) return palpate::bench::write_json("surfaces_bench", options.json, *figures);
  std::fprintf(stderr, "%s\n", figures.error().message().c_str());
  return 1;
}
