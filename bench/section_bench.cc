// An oblique section of scan and labels of a large knee: palpate and vtkImageReslice. See README.md.

#include <vtkImageData.h>
#include <vtkImageReslice.h>
#include <vtkMatrix4x4.h>
#include <vtkNew.h>
#include <vtkThreadedImageAlgorithm.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <numbers>
#include <random>

#include "interleaved.h"
#include "json_file.h"
#include "large_knee.h"
#include "palpate/rendering/rendering.h"

namespace palpate::bench {

namespace {

constexpr double kWindow[2] = {100, 1100};
constexpr double kOpacity = 0.55;

struct Options {
  int rounds = 60, pixels = 512;
  double width_mm = 142;
  std::string labels, json;
};

// ---- workload ---------------------------------------------------------------------------------------------

/// A scan with a distinct grey value for each structure, and noise.
std::shared_ptr<const Volume<float>> generated_scan(const Volume<LabelId>& labels) {
  auto scan = std::make_shared<Volume<float>>(labels.geometry());
  std::uint32_t state = 1;
  for (std::size_t n = 0; n < labels.voxels().size(); ++n) {
    state = 1664525 * state + 1013904223;
    scan->voxels()[n] = static_cast<float>(200 + 37 * (labels.voxels()[n] % 20) + (state >> 25));
  }
  return scan;
}

Result<Model> large_model(const Options& options, std::string& what) {
  auto map = large_knee(options.labels, what);
  if (!map) return map.error();
  Model model;
  model.segments = map->segments;
  model.labels = label_bricks(map->layers.front());
  model.scan = generated_scan(map->layers.front());
  return model;
}

Vector<Patient> random_direction(std::mt19937& random) {
  std::normal_distribution<double> normal;
  const double x = normal(random), y = normal(random), z = normal(random);
  return Vector<Patient>(x, y, z).normalized();
}

/// Random planes through the middle half of the volume.
std::vector<SectionPlane> random_planes(const GridGeometry& grid, const Options& options) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> middle(0.25, 0.75);
  std::vector<SectionPlane> planes;
  for (int n = 0; n <= options.rounds; ++n) {
    const double i = middle(random), j = middle(random), k = middle(random);
    const Point<Patient> centre =
        grid.X_PatientVoxel() * Point<Voxel>(i * grid.dims[0], j * grid.dims[1], k * grid.dims[2]);
    SectionPlane plane{centre, {}, {}, options.width_mm, options.pixels, options.pixels};
    plane.right = random_direction(random);
    plane.down = plane.right.cross(random_direction(random)).normalized();
    planes.push_back(plane);
  }
  return planes;
}

/// A tip that moves 0.2 mm and rotates by half a degree per picture.
std::vector<SectionPlane> following_planes(const GridGeometry& grid, const Options& options) {
  const double turn = 0.5 * std::numbers::pi / 180;
  const SectionPlane* before = nullptr;
  std::vector<SectionPlane> planes;
  planes.reserve(static_cast<std::size_t>(options.rounds) + 1);
  for (int n = 0; n <= options.rounds; ++n) {
    const Point<Patient> tip = grid.centre() + Vector<Patient>(0.1, -0.1, 0.14) * n;
    const Vector<Patient> axis(0.4 + 0.3 * std::sin(turn * n), 0.8, 0.5 + 0.3 * std::cos(turn * n));
    planes.push_back(oblique_section(tip, axis, ObliqueView::kAlong, options.width_mm, options.pixels,
                                     options.pixels, before));
    before = &planes.back();
  }
  return planes;
}

// ---- contenders -------------------------------------------------------------------------------------------

using Rgbs = std::vector<std::uint8_t>;

class Palpate {
 public:
  Palpate(const Model& model, SectionStorage storage)
      : renderer_(model, {kWindow[0], kWindow[1], kOpacity, false, 256}, storage) {}
  void draw(const SectionPlane& plane, bool structures, Rgbs& rgb) {
    if (structures) {
      renderer_.render(plane, rgb);
    } else {
      renderer_.render_scan(plane, rgb);
    }
  }
  std::size_t prepared_bytes() const { return renderer_.prepared_bytes(); }

 private:
  SectionRenderer renderer_;
};

/// Two reslices with the smallest integer types that hold the values, and a loop over the pixels, which is
/// faster than VTK's own colour filters.
class Vtk {
 public:
  explicit Vtk(const Model& model) : grid_(model.labels->geometry()) {
    vtkThreadedImageAlgorithm::SetGlobalDefaultEnableSMP(false);
    vtkNew<vtkImageData> scan, labels;
    make_image(scan, VTK_SHORT);
    make_image(labels, VTK_UNSIGNED_SHORT);
    auto* values = static_cast<short*>(scan->GetScalarPointer());
    for (const float value : model.scan->voxels()) *values++ = static_cast<short>(value);
    const Volume<LabelId> plain = model.labels->dense();
    std::copy(plain.voxels().begin(), plain.voxels().end(),
              static_cast<unsigned short*>(labels->GetScalarPointer()));
    set_up(scan_, scan, -1);
    scan_->SetInterpolationModeToLinear();
    set_up(labels_, labels, 0);
    labels_->SetInterpolationModeToNearestNeighbor();
    colours_.resize(65536);
    for (const Segment& segment : model.segments) colours_[segment.id] = segment.colour;
  }

  void draw(const SectionPlane& plane, bool structures, Rgbs& rgb) {
    const short* values = static_cast<const short*>(resliced(scan_, plane));
    const auto* labels = structures ? static_cast<const unsigned short*>(resliced(labels_, plane)) : nullptr;
    const float per_value = 255 / static_cast<float>(kWindow[1] - kWindow[0]);
    const int alpha = static_cast<int>(kOpacity * 255 + 0.5);
    for (std::size_t n = 0; 3 * n < rgb.size(); ++n) {
      const float level = std::clamp(
          (static_cast<float>(values[n]) - static_cast<float>(kWindow[0])) * per_value, 0.0f, 255.0f);
      const int grey = values[n] < 0 ? 14 : static_cast<int>(level + 0.5f);
      std::uint8_t* out = &rgb[3 * n];
      if (labels == nullptr || labels[n] == 0) {
        out[0] = out[1] = out[2] = static_cast<std::uint8_t>(grey);
        continue;
      }
      const Rgb& c = colours_[labels[n]];
      out[0] = static_cast<std::uint8_t>((grey * (255 - alpha) + c.r * alpha + 127) / 255);
      out[1] = static_cast<std::uint8_t>((grey * (255 - alpha) + c.g * alpha + 127) / 255);
      out[2] = static_cast<std::uint8_t>((grey * (255 - alpha) + c.b * alpha + 127) / 255);
    }
  }

 private:
  // along the grid's own axes, in mm
  void make_image(vtkImageData* image, int type) const {
    image->SetDimensions(grid_.dims.data());
    image->SetSpacing(grid_.spacing_mm.data());
    image->AllocateScalars(type, 1);
  }
  static void set_up(vtkImageReslice* reslice, vtkImageData* image, double background) {
    reslice->SetInputData(image);
    reslice->SetOutputDimensionality(2);
    reslice->SetBackgroundLevel(background);
    reslice->SetNumberOfThreads(1);
  }

  const void* resliced(vtkImageReslice* reslice, const SectionPlane& plane) const {
    const Eigen::Matrix3d to_grid = grid_.direction.inverse();
    const Eigen::Vector3d right = to_grid * plane.right.eigen(), down = to_grid * plane.down.eigen();
    const Eigen::Vector3d normal = right.cross(down),
                          corner = to_grid * (plane.at(0, 0) - grid_.origin).eigen();
    vtkNew<vtkMatrix4x4> axes;
    for (int a = 0; a < 3; ++a) {
      axes->SetElement(a, 0, right[a]);
      axes->SetElement(a, 1, down[a]);
      axes->SetElement(a, 2, normal[a]);
      axes->SetElement(a, 3, corner[a]);
    }
    reslice->SetResliceAxes(axes);
    reslice->SetOutputSpacing(plane.mm_per_px(), plane.mm_per_px(), 1);
    reslice->SetOutputOrigin(0, 0, 0);
    reslice->SetOutputExtent(0, plane.width_px - 1, 0, plane.height_px - 1, 0, 0);
    reslice->Update();
    return reslice->GetOutput()->GetScalarPointer();
  }

  GridGeometry grid_;
  vtkNew<vtkImageReslice> scan_, labels_;
  std::vector<Rgb> colours_;
};

/// Draws one plane after another. Warm: the previous plane is drawn immediately before, untimed.
template <class Drawer>
Contender contender(std::string name, const std::shared_ptr<Drawer>& drawer,
                    const std::vector<SectionPlane>& planes, bool structures, bool warm) {
  const auto rgb = std::make_shared<Rgbs>(std::size_t{3} * planes[0].width_px * planes[0].height_px);
  const auto next = std::make_shared<std::size_t>(0);
  const auto draw = [=, &planes](std::size_t n) { drawer->draw(planes[n], structures, *rgb); };
  Contender result;
  result.name = std::move(name);
  result.before = [=] {
    if (warm) draw(*next);
    ++*next;
  };
  result.work = [=] { draw(*next); };
  result.result = [=] { return std::vector<float>(rgb->begin(), rgb->end()); };
  return result;
}

// ---- run --------------------------------------------------------------------------------------------------

nlohmann::json to_json(const std::vector<Timing>& timings) {
  nlohmann::json rows;
  for (const Timing& t : timings)
    rows.push_back({{"name", t.name},
                    {"median_ms", t.median_ms},
                    {"fastest_ms", t.fastest_ms},
                    {"slowest_ms", t.slowest_ms},
                    {"ratio", t.ratio},
                    {"max_difference", t.max_difference},
                    {"mean_difference", t.mean_difference}});
  return rows;
}

Result<nlohmann::json> run(const Options& options) {
  std::string what;
  const auto model = large_model(options, what);
  if (!model) return model.error();
  const GridGeometry& grid = model->labels->geometry();
  const auto start = std::chrono::steady_clock::now();
  const auto bricks = std::make_shared<Palpate>(*model, SectionStorage::kBricks);
  const double prepared_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const auto plain = std::make_shared<Palpate>(*model, SectionStorage::kModel);
  const auto vtk = std::make_shared<Vtk>(*model);
  std::printf("%s, %dx%dx%d voxels; %dx%d pixels over %g mm; bricks: %.0f MB in %.2f s\n", what.c_str(),
              grid.dims[0], grid.dims[1], grid.dims[2], options.pixels, options.pixels, options.width_mm,
              1e-6 * static_cast<double>(bricks->prepared_bytes()), prepared_s);

  nlohmann::json report{{"voxels", grid.voxel_count()},
                        {"pixels", options.pixels},
                        {"width_mm", options.width_mm},
                        {"prepared_s", prepared_s},
                        {"prepared_bytes", bricks->prepared_bytes()}};
  const auto compare = [&](const std::string& title, const std::vector<SectionPlane>& planes, bool structures,
                           bool warm) {
    const std::vector<Contender> entrants{
        contender("palpate, bricks", bricks, planes, structures, warm),
        contender("palpate, no preparation", plain, planes, structures, warm),
        contender("vtkImageReslice", vtk, planes, structures, warm)};
    entrants[1].work();
    const auto timings = run_interleaved(entrants, entrants[1].result(), options.rounds);
    print_table(title, timings);
    report["sections"][title] = to_json(timings);
  };
  const auto anywhere = random_planes(grid, options), following = following_planes(grid, options);
  compare("scan and structures, anywhere", anywhere, true, false);
  compare("scan and structures, following a tip", following, true, true);
  compare("scan alone, anywhere", anywhere, false, false);
  compare("scan alone, following a tip", following, false, true);
  return report;
}

}  // namespace

}  // namespace palpate::bench

int main(int argc, char** argv) {
  palpate::bench::Options options;
  CLI::App app{"An oblique section of scan and labels"};
  app.add_option("--labels", options.labels,
                 "A label map; default: the knee of PALPATE_DATA, or a generated one");
  app.add_option("--rounds", options.rounds, "Planes, each drawn once by everybody")
      ->check(CLI::Range(1, 10000));
  app.add_option("--pixels", options.pixels, "Width and height of the picture")->check(CLI::Range(16, 4096));
  app.add_option("--width", options.width_mm, "Width of the picture in mm")->check(CLI::Range(1.0, 1000.0));
  app.add_option("--json", options.json, "Writes the figures to this file");
  CLI11_PARSE(app, argc, argv);
  const auto figures = palpate::bench::run(options);
  if (figures) return palpate::bench::write_json("section_bench", options.json, *figures);
  std::fprintf(stderr, "%s\n", figures.error().message().c_str());
  return 1;
}
