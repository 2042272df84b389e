// A shaded picture of a knee's structures from changing directions: palpate's shear-warp and VTK's CPU ray
// caster. See README.md.

#include <vtkAutoInit.h>
#include <vtkCamera.h>
#include <vtkColorTransferFunction.h>
#include <vtkFixedPointRayCastImage.h>
#include <vtkFixedPointVolumeRayCastMapper.h>
#include <vtkGenericOpenGLRenderWindow.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPiecewiseFunction.h>
#include <vtkRenderer.h>
#include <vtkVolume.h>
#include <vtkVolumeProperty.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "interleaved.h"
#include "json_file.h"
#include "large_knee.h"
#include "palpate/rendering/rendering.h"
#include "palpate/rendering/volume_renderer.h"
#include "palpate/volume/resample.h"

// required to create a mapper, although nothing is displayed
VTK_MODULE_INIT(vtkRenderingOpenGL2);
VTK_MODULE_INIT(vtkRenderingVolumeOpenGL2);

namespace palpate::bench {

namespace {

constexpr Rgb kBone{230, 220, 190};
/// Optical depth of a voxel covered by structures, as for palpate's solid ones.
constexpr double kSolidDepth = 5;

struct Options {
  int rounds = 40, pixels = 512, threads = 2, cube = 0, boxes = 9;
  bool whole = false;
  std::string labels, json, pictures;
};

// ---- workload ---------------------------------------------------------------------------------------------

/// All structures merged, on a grid along the patient's axes.
Result<Volume<LabelId>> knee(const Options& options, std::string& what) {
  auto map = large_knee(options.labels, what);
  if (!map) return map.error();
  LabelMap labels = std::move(*map);
  if (!options.whole || options.cube > 0) {
    GridGeometry grid = labels.geometry();
    std::array<int, 3> dims{256, 256, 124};
    if (options.cube > 0) dims.fill(options.cube);
    for (int a = 0; a < 3; ++a) {
      const auto axis = static_cast<std::size_t>(a);
      grid.spacing_mm[a] *= static_cast<double>(grid.dims[axis]) / dims[axis];
    }
    grid.dims = dims;
    auto coarse = resample_nearest(labels, grid);
    if (!coarse) return coarse.error();
    labels = std::move(*coarse);
  }
  GridGeometry grid = labels.geometry();
  grid.direction = Eigen::Matrix3d::Identity();
  grid.origin = Point<Patient>();
  Volume<LabelId> one(grid);
  for (std::size_t n = 0; n < one.voxels().size(); ++n)
    one.voxels()[n] = labels.layers.front().voxels()[n] != 0 ? 1 : 0;
  return one;
}

/// Directions around the long axis, with a small elevation.
std::vector<VolumeCamera> views(const GridGeometry& grid, const Options& options) {
  const double golden = std::numbers::pi * (3 - std::sqrt(5.0));
  double longest = 0;
  for (int a = 0; a < 3; ++a)
    longest = std::max(longest, grid.dims[static_cast<std::size_t>(a)] * grid.spacing_mm[a]);
  std::vector<VolumeCamera> cameras;
  for (int n = 0; n <= options.rounds + 1; ++n) {
    const double turn = golden * n, tilt = 0.5 * std::sin(0.7 * n);
    const Vector<Patient> into(std::sin(turn) * std::cos(tilt), std::cos(turn) * std::cos(tilt),
                               -std::sin(tilt));
    VolumeCamera& camera = cameras.emplace_back();
    camera.focus = grid.centre();
    camera.right = Vector<Patient>(0, 0, -1).cross(into).normalized();
    camera.down = into.cross(camera.right);
    camera.width_mm = 1.1 * longest;
    camera.width_px = camera.height_px = options.pixels;
  }
  return cameras;
}

/// Extinction in units of 1/255: palpate's solidity (src/output/rendering/volume_terms.h).
std::vector<unsigned short> solidity(const Volume<LabelId>& labels) {
  const std::array<int, 3>& dims = labels.geometry().dims;
  std::vector<float> smooth(labels.voxels().begin(), labels.voxels().end()), from;
  const std::array<std::size_t, 3> step{
      1, static_cast<std::size_t>(dims[0]),
      static_cast<std::size_t>(dims[0]) * static_cast<std::size_t>(dims[1])};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    from = smooth;
    for (std::size_t n = 0; n < from.size(); ++n) {
      const auto index = static_cast<int>(n / step[axis] % static_cast<std::size_t>(dims[axis]));
      smooth[n] = 0.5f * from[n] + 0.25f * (index > 0 ? from[n - step[axis]] : 0) +
                  0.25f * (index + 1 < dims[axis] ? from[n + step[axis]] : 0);
    }
  }
  std::vector<unsigned short> values(smooth.size());
  for (std::size_t n = 0; n < values.size(); ++n) {
    const double solid = std::max((smooth[n] - 0.4) / 0.6, labels.voxels()[n] != 0 ? 0.5 : 0.0);
    values[n] = static_cast<unsigned short>(std::lround(255 * solid));
  }
  return values;
}

// ---- contenders -------------------------------------------------------------------------------------------

class Palpate {
 public:
  Palpate(const Volume<LabelId>& labels, const Options& options)
      : renderer_(*VolumeRenderer::make(
            *label_bricks(labels), std::vector<StructureAppearance>{{{}, 0}, {kBone, 1}}, options.threads)) {
    style_.background = {0, 0, 0};
  }
  void draw(const VolumeCamera& camera, Image& image) { renderer_.render(camera, style_, image.rgb); }
  double prepared_mb() const { return 1e-6 * static_cast<double>(renderer_.prepared_bytes()); }

 private:
  VolumeRenderer renderer_;
  VolumeStyle style_;
};

/// The computation of the picture, without its display.
class Vtk {
 public:
  Vtk(const Volume<LabelId>& labels, const Options& options) {
    const GridGeometry& grid = labels.geometry();
    vtkNew<vtkImageData> image;
    image->SetDimensions(grid.dims.data());
    image->SetSpacing(grid.spacing_mm.data());
    image->AllocateScalars(VTK_UNSIGNED_SHORT, 1);
    const std::vector<unsigned short> values = solidity(labels);
    std::copy(values.begin(), values.end(), static_cast<unsigned short*>(image->GetScalarPointer()));

    const double h = grid.min_spacing_mm();
    mapper_->SetInputData(image);
    mapper_->SetNumberOfThreads(options.threads);
    mapper_->AutoAdjustSampleDistancesOff();
    mapper_->LockSampleDistanceToInputSpacingOff();
    mapper_->IntermixIntersectingGeometryOff();
    mapper_->SetImageSampleDistance(1);
    // the maximum sample spacing of palpate
    mapper_->SetSampleDistance(static_cast<float>(h));
    mapper_->SetInteractiveSampleDistance(static_cast<float>(h));

    vtkNew<vtkPiecewiseFunction> opacity;
    for (int n = 0; n <= 255; ++n) opacity->AddPoint(n, 1 - std::exp(-kSolidDepth * n / 255));
    vtkNew<vtkColorTransferFunction> colour;
    for (const int n : {0, 255}) colour->AddRGBPoint(n, kBone.r / 255.0, kBone.g / 255.0, kBone.b / 255.0);
    vtkNew<vtkVolumeProperty> property;
    property->SetScalarOpacity(opacity);
    property->SetScalarOpacityUnitDistance(h);
    property->SetColor(colour);
    property->SetInterpolationTypeToLinear();
    property->ShadeOn();
    const VolumeLight light;
    property->SetAmbient(light.ambient);
    property->SetDiffuse(light.diffuse);
    property->SetSpecular(light.specular);
    property->SetSpecularPower(20);
    volume_->SetMapper(mapper_);
    volume_->SetProperty(property);
    window_->SetSize(options.pixels, options.pixels);
    window_->AddRenderer(renderer_);
    renderer_->AddVolume(volume_);
    renderer_->CreateLight();
  }

  void draw(const VolumeCamera& view, Image& image) {
    const Point<Patient> eye = view.focus - view.into() * (2 * view.width_mm);
    const Vector<Patient> up = -view.down;
    vtkCamera* camera = renderer_->GetActiveCamera();
    camera->ParallelProjectionOn();
    camera->SetParallelScale(view.width_mm / 2);
    camera->SetFocalPoint(view.focus.x(), view.focus.y(), view.focus.z());
    camera->SetPosition(eye.x(), eye.y(), eye.z());
    camera->SetViewUp(up.x(), up.y(), up.z());
    renderer_->ResetCameraClippingRange();
    renderer_->UpdateLightsGeometryToFollowCamera();
    volume_->Update();
    mapper_->Update();
    // unused for a single volume
    double origin[3]{}, spacing[3]{};
    int extent[6]{};
    PALPATE_CHECK(mapper_->PerImageInitialization(renderer_, volume_, 0, origin, spacing, extent) == 1);
    mapper_->PerVolumeInitialization(renderer_, volume_);
    mapper_->PerSubVolumeInitialization(renderer_, volume_, 0);
    mapper_->RenderSubVolume();
    copy(image);
  }

 private:
  /// Copies the part of the picture that was drawn, which is upside down with 15 bits.
  void copy(Image& image) {
    vtkFixedPointRayCastImage* from = mapper_->GetRayCastImage();
    int size[2], memory[2], origin[2];
    from->GetImageInUseSize(size);
    from->GetImageMemorySize(memory);
    from->GetImageOrigin(origin);
    std::fill(image.rgb.begin(), image.rgb.end(), std::uint8_t{0});
    for (int y = 0; y < size[1]; ++y)
      for (int x = 0; x < size[0]; ++x) {
        const unsigned short* pixel =
            from->GetImage() + std::ptrdiff_t{4} * (std::ptrdiff_t{y} * memory[0] + x);
        const int row = image.height - 1 - (origin[1] + y), column = origin[0] + x;
        if (row < 0 || row >= image.height || column < 0 || column >= image.width) continue;
        for (int c = 0; c < 3; ++c)
          image
              .rgb[3 * (static_cast<std::size_t>(row) * image.width + column) + static_cast<std::size_t>(c)] =
              static_cast<std::uint8_t>(std::min(255, pixel[c] >> 7));
      }
  }

  vtkNew<vtkFixedPointVolumeRayCastMapper> mapper_;
  vtkNew<vtkVolume> volume_;
  vtkNew<vtkRenderer> renderer_;
  vtkNew<vtkGenericOpenGLRenderWindow> window_;
};

/// Draws one view after another.
template <class Drawer>
Contender contender(std::string name, const std::shared_ptr<Drawer>& drawer,
                    const std::vector<VolumeCamera>& cameras, const Options& options,
                    const std::string& picture) {
  const auto image =
      std::make_shared<Image>(Image{options.pixels, options.pixels,
                                    std::vector<std::uint8_t>(3 * static_cast<std::size_t>(options.pixels) *
                                                              static_cast<std::size_t>(options.pixels))});
  const auto next = std::make_shared<std::size_t>(0);
  Contender result;
  result.name = std::move(name);
  result.threads = options.threads;
  result.work = [=, &cameras] { drawer->draw(cameras[(*next)++], *image); };
  result.result = [=, &options] {
    if (!options.pictures.empty() && !write_png(options.pictures + "/" + picture, *image))
      std::fprintf(stderr, "volume_bench: %s is not written\n", picture.c_str());
    return std::vector<float>(image->rgb.begin(), image->rgb.end());
  };
  return result;
}

// ---- a changed box ----------------------------------------------------------------------------------------

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

/// Removes and restores 32^3 voxels in the centre, one change after another as a burr would, alternating with
/// a full preparation. The first change runs with cold caches and is reported separately.
nlohmann::json change_boxes(const Volume<LabelId>& labels, const Options& options) {
  constexpr int kSide = 32, kChanges = 8;
  const std::vector<StructureAppearance> appearances{{{}, 0}, {kBone, 1}};
  Volume<LabelId> cut = labels;
  VoxelBox box;
  for (std::size_t a = 0; a < 3; ++a) {
    box.size[a] = kSide;
    box.first[a] = labels.geometry().dims[a] / 2 - kSide / 2;
  }
  for (int k = 0; k < kSide; ++k)
    for (int j = 0; j < kSide; ++j)
      for (int i = 0; i < kSide; ++i) cut.at(box.first[0] + i, box.first[1] + j, box.first[2] + k) = 0;
  const auto whole_bricks = label_bricks(labels), cut_bricks = label_bricks(cut);
  std::vector<double> all_ms, first_ms, box_ms, fraction;
  for (int n = 0; n < options.boxes; ++n) {
    const auto begin = std::chrono::steady_clock::now();
    auto renderer = VolumeRenderer::make(*whole_bricks, appearances, options.threads);
    PALPATE_CHECK(renderer);
    auto before = std::chrono::steady_clock::now();
    all_ms.push_back(std::chrono::duration<double, std::milli>(before - begin).count());
    std::vector<double> changes_ms;
    for (int change = 0; change < kChanges; ++change) {
      renderer->change(change % 2 == 0 ? *cut_bricks : *whole_bricks, box);
      const auto now = std::chrono::steady_clock::now();
      changes_ms.push_back(std::chrono::duration<double, std::milli>(now - before).count());
      before = now;
    }
    first_ms.push_back(changes_ms.front());
    box_ms.push_back(median({changes_ms.begin() + 1, changes_ms.end()}));
    fraction.push_back(all_ms.back() / box_ms.back());
  }
  std::printf(
      "\nprepared whole %.1f ms, a box of %d^3 %.2f ms, 1/%.1f; the first one %.2f ms (medians of %d)\n",
      median(all_ms), kSide, median(box_ms), median(fraction), median(first_ms), options.boxes);
  return {{"whole_ms", median(all_ms)},
          {"box_ms", median(box_ms)},
          {"first_box_ms", median(first_ms)},
          {"ratio", median(fraction)}};
}

// ---- run --------------------------------------------------------------------------------------------------

Result<nlohmann::json> run(const Options& options) {
  std::string what;
  const auto labels = knee(options, what);
  if (!labels) return labels.error();
  const GridGeometry& grid = labels->geometry();
  const auto start = std::chrono::steady_clock::now();
  const auto palpate = std::make_shared<Palpate>(*labels, options);
  const double prepared_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const auto vtk = std::make_shared<Vtk>(*labels, options);
  std::printf("%s, %dx%dx%d voxels; %dx%d pixels; prepared: %.0f MB in %.2f s\n", what.c_str(), grid.dims[0],
              grid.dims[1], grid.dims[2], options.pixels, options.pixels, palpate->prepared_mb(), prepared_s);
  const std::vector<VolumeCamera> cameras = views(grid, options);
  const std::vector<Contender> entrants{
      contender("palpate", palpate, cameras, options, "palpate.png"),
      contender("vtkFixedPointVolumeRayCastMapper", vtk, cameras, options, "vtk.png")};
  Image reference{options.pixels, options.pixels,
                  std::vector<std::uint8_t>(3 * static_cast<std::size_t>(options.pixels) *
                                            static_cast<std::size_t>(options.pixels))};
  palpate->draw(cameras.front(), reference);
  const auto timings = run_interleaved(
      entrants, std::vector<float>(reference.rgb.begin(), reference.rgb.end()), options.rounds);
  print_table("a view after another", timings);
  nlohmann::json report{{"voxels", grid.voxel_count()},
                        {"pixels", options.pixels},
                        {"prepared_s", prepared_s},
                        {"prepared_mb", palpate->prepared_mb()}};
  if (options.boxes > 0) report["changed_box"] = change_boxes(*labels, options);
  for (const Timing& t : timings)
    report["views"].push_back({{"name", t.name},
                               {"median_ms", t.median_ms},
                               {"fastest_ms", t.fastest_ms},
                               {"slowest_ms", t.slowest_ms},
                               {"cpu_ms", t.cpu_ms},
                               {"ratio", t.ratio},
                               {"mean_difference", t.mean_difference}});
  return report;
}

}  // namespace

}  // namespace palpate::bench

int main(int argc, char** argv) {
  palpate::bench::Options options;
  CLI::App app{"A picture of a volume"};
  app.add_option("--labels", options.labels,
                 "A label map; default: the knee of PALPATE_DATA, or a generated one");
  app.add_flag("--whole", options.whole, "In its own voxels, instead of 256x256x124");
  app.add_option("--cube", options.cube, "On so many voxels each way instead")->check(CLI::Range(64, 1024));
  app.add_option("--boxes", options.boxes, "Times that a box is changed, by turns with preparing all")
      ->check(CLI::Range(0, 1000));
  app.add_option("--rounds", options.rounds, "Views, each drawn once by both")->check(CLI::Range(1, 10000));
  app.add_option("--pixels", options.pixels, "Width and height of the picture")->check(CLI::Range(16, 4096));
  app.add_option("--threads", options.threads, "Of both")->check(CLI::Range(1, 64));
  app.add_option("--pictures", options.pictures, "Writes the first view of both to this folder");
  app.add_option("--json", options.json, "Writes the figures to this file");
  CLI11_PARSE(app, argc, argv);
  const auto figures = palpate::bench::run(options);
  if (figures) return palpate::bench::write_json("volume_bench", options.json, *figures);
  std::fprintf(stderr, "%s\n", figures.error().message().c_str());
  return 1;
}
