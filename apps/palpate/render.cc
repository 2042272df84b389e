#include <algorithm>
#include <cstdio>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "input_files.h"
#include "palpate/base/file.h"
#include "palpate/base/output.h"
#include "palpate/loading/loading.h"
#include "palpate/rendering/animated_png.h"
#include "palpate/rendering/volume_picture.h"
#include "palpate/report/moment.h"
#include "scene_options.h"
#include "verb.h"

namespace palpate::app {
namespace {

constexpr int kMaxFrames = 720;
constexpr int kFrame_ms = 50;

const std::map<std::string, ViewFrom> kViews{
    {"anterior", ViewFrom::kAnterior}, {"posterior", ViewFrom::kPosterior},
    {"left", ViewFrom::kLeft},         {"right", ViewFrom::kRight},
    {"superior", ViewFrom::kSuperior}, {"inferior", ViewFrom::kInferior}};

struct RenderOptions {
  SceneSource source;
  std::optional<double> time_s;  ///< Time in the recording that is the target; empty: the target is a scene
  std::string made_with;         ///< Target with which the recording was made
  std::filesystem::path output;
  VolumePictureRequest request;
  std::vector<double> at;
  std::vector<std::string> only, hide;
  std::optional<double> scan_opacity;
  std::vector<double> window;
  std::optional<int> frames;
};

Error usage(std::string what, std::string where, std::string remedy) {
  return {ErrorKind::kUsage, std::move(what), std::move(where), std::move(remedy)};
}

/// Whether the file ends in .png, ignoring case.
bool is_named_png(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return extension == ".png";
}

bool is_animated(const RenderOptions& options) {
  return options.frames && is_named_png(options.output);
}

/// Source of the scene to draw; for a recording, the target with which it was made.
SceneSource scene_source(const RenderOptions& options) {
  SceneSource source = options.source;
  if (options.time_s) source.target = options.made_with;
  return source;
}

/// Claims the output. A picture is claimed as a file; the folder for the frames of an orbit must be new or
/// empty.
Result<std::optional<OutputClaim>> check_output(const RenderOptions& options) {
  if (!options.frames || is_animated(options)) {
    auto inputs = input_files(scene_source(options));
    if (options.time_s) inputs.emplace_back(options.source.target);
    auto claimed = claim_output(options.output, inputs);
    if (!claimed) return claimed.error();
    if (options.output.has_extension() && !is_named_png(options.output))
      return usage("the output is a PNG picture", options.output.string(),
                   "give it a name that ends in .png");
    return std::optional<OutputClaim>(std::move(*claimed));
  }
  std::error_code failed;
  const bool exists = std::filesystem::exists(options.output, failed);
  const bool is_empty = exists && std::filesystem::is_directory(options.output, failed) &&
                        std::filesystem::is_empty(options.output, failed);
  if (failed || (exists && !is_empty))
    return Error{ErrorKind::kOutput, "the frames of an orbit need a new or empty folder",
                 options.output.string(), "name a folder that does not exist or is empty"};
  return std::optional<OutputClaim>();
}

/// Labels of the structures with these names.
Result<std::vector<LabelId>> labels_named(const Model& model, const std::vector<std::string>& names,
                                          const std::string& option) {
  std::vector<LabelId> labels;
  for (const std::string& name : names) {
    const Segment* segment = model.find(name);
    if (segment == nullptr)
      return Error{ErrorKind::kUsage, "no structure is called \"" + name + "\"", option,
                   "palpate info lists the structures"};
    labels.push_back(segment->id);
  }
  return labels;
}

Result<std::vector<StructureAppearance>> appearances_of(const RenderOptions& options, const Model& model) {
  std::vector<StructureAppearance> appearances = structure_appearances(model);
  const auto only = labels_named(model, options.only, "--only"),
             hide = labels_named(model, options.hide, "--hide");
  if (!only) return only.error();
  if (!hide) return hide.error();
  const auto has = [](const std::vector<LabelId>& labels, std::size_t label) {
    return std::find(labels.begin(), labels.end(), label) != labels.end();
  };
  for (std::size_t label = 0; label < appearances.size(); ++label)
    if ((!only->empty() && !has(*only, label)) || has(*hide, label)) appearances[label].opacity = 0;
  return appearances;
}

Result<ScanAppearance> scan_of(const RenderOptions& options, const Model& model) {
  if (!options.scan_opacity && options.window.empty()) return ScanAppearance{};
  if (!options.scan_opacity)
    return usage("a window applies to the scan, which is not drawn", "--window",
                 "draw it with --scan-opacity");
  if (model.scan == nullptr)
    return usage("there is no scan", "--scan", "name one in the scene, or leave the option out");
  const std::size_t voxels = model.scan->geometry().voxel_count();
  if (voxels > kMaxScanVoxels)
    return usage("a scan to be drawn may have at most " + std::to_string(kMaxScanVoxels) +
                     " voxels, this one has " + std::to_string(voxels),
                 "--scan", "crop or resample it, or leave the option out");
  ScanAppearance appearance{model.scan, scan_window(*model.scan), *options.scan_opacity};
  if (!options.window.empty()) appearance.window = {options.window[0], options.window[1]};
  if (!(appearance.window[0] < appearance.window[1]))
    return usage("the lower end of the window must be below the upper end", "--window", "give LOW,HIGH");
  return appearance;
}

/// Requests for the successive pictures, each rotated by a further step.
std::vector<VolumePictureRequest> requests_of(const RenderOptions& options, const GridGeometry& grid) {
  std::vector<VolumePictureRequest> requests;
  const int count = options.frames.value_or(1);
  for (int n = 0; n < count; ++n) {
    VolumePictureRequest& request = requests.emplace_back(options.request);
    request.turn_deg += 360.0 * n / count;
    if (!options.at.empty()) request.focus = Point<Patient>(options.at[0], options.at[1], options.at[2]);
  }
  if (options.request.size_mm > 0) return requests;
  const double whole_mm = whole_picture_mm(grid, requests);
  for (VolumePictureRequest& request : requests) request.size_mm = whole_mm;
  return requests;
}

Result<void> write_frames(const std::filesystem::path& folder,
                          const std::vector<std::vector<std::uint8_t>>& pngs) {
  std::error_code failed;
  std::filesystem::create_directory(folder, failed);
  if (failed)
    return Error{ErrorKind::kOutput, "the folder cannot be created: " + failed.message(), folder.string(),
                 "choose one in a folder that exists"};
  for (std::size_t n = 0; n < pngs.size(); ++n) {
    char name[40];
    std::snprintf(name, sizeof name, "frame-%03zu.png", n);
    const auto written =
        write_file(folder / name, {reinterpret_cast<const char*>(pngs[n].data()), pngs[n].size()});
    if (!written) return written;
  }
  return {};
}

/// Content of the picture: a model, and for a recording its state at the requested time.
struct PictureContent {
  std::shared_ptr<const Model> model;  ///< Model at the start of the recording
  std::optional<RecordedMoment> moment;

  const Model& shown() const { return moment && moment->current_model ? *moment->current_model : *model; }
};

Result<PictureContent> load_content(const RenderOptions& options, Console& console) {
  if (!options.time_s) {
    auto loaded = load_target(options.source, console);
    if (!loaded) return loaded.error();
    return PictureContent{loaded->model, {}};
  }
  const Progress progress = console.progress();
  const auto recording = RecordingSource::open(options.source.target, progress);
  if (!recording) return recording.error();
  const auto loaded =
      load_scene_of_recording(recording->head().header, scene_source(options), progress, console.warn());
  if (!loaded) return loaded.error();
  auto moment = recorded_moment(*recording, *loaded->model, *options.time_s, progress);
  if (!moment) {
    Error error = moment.error();
    if (error.where.empty()) error.where = options.source.target;
    return error;
  }
  return PictureContent{loaded->model, *std::move(moment)};
}

int render(const RenderOptions& options, Console& console) {
  if (!options.made_with.empty() && !options.time_s)
    return console.fail(usage("only a recording takes a second scene", "--made-with",
                              "choose the moment of the recording to draw with --time S"));
  const auto claimed = check_output(options);
  if (!claimed) return console.fail(claimed.error());
  const auto drawn_model = load_content(options, console);
  if (!drawn_model) return console.fail(drawn_model.error());
  const Model& model = drawn_model->shown();
  if (model.labels == nullptr || model.segments.empty())
    return console.fail({ErrorKind::kBadInput, "there is no structure to draw", options.source.target,
                         "palpate section draws scans"});
  const auto appearances = appearances_of(options, model);
  if (!appearances) return console.fail(appearances.error());
  const Progress progress = console.progress();
  const auto scan = scan_of(options, model);
  if (!scan) return console.fail(scan.error());
  auto renderer = VolumeRenderer::make(*model.labels, *appearances, 0, progress, *scan);
  if (!renderer) return console.fail(renderer.error());

  const auto requests = requests_of(options, model.labels->geometry());
  std::vector<std::vector<std::uint8_t>> pngs;
  std::optional<AnimatedPng> animated;
  if (is_animated(options))
    animated.emplace(options.request.pixels, options.request.pixels, static_cast<int>(requests.size()),
                     kFrame_ms);
  int drawn = 0;
  for (const VolumePictureRequest& request : requests) {
    if (progress.stopped()) return console.fail(Progress::interrupted());
    std::vector<VolumeMark> marks;
    if (drawn_model->moment)
      marks = moment_marks(*drawn_model->moment, *drawn_model->model,
                           camera_of(model.labels->geometry(), request));
    Image picture = volume_picture(*renderer, model, *appearances, request, marks);
    if (animated)
      animated->add(std::move(picture));
    else
      pngs.push_back(encode_png(picture));
    if (options.frames)
      progress.report("pictures", static_cast<double>(++drawn) / static_cast<double>(requests.size()));
  }
  if (animated) pngs.push_back(animated->finish());
  const auto written =
      options.frames && !animated
          ? write_frames(options.output, pngs)
          : write_file(options.output, {reinterpret_cast<const char*>(pngs[0].data()), pngs[0].size()});
  if (!written) return console.fail(written.error());
  console.note((options.frames && !animated ? "pictures: " : "picture: ") + options.output.string());
  return kExitOk;
}

void add_render_options(CLI::App& verb, RenderOptions& options) {
  add_source_options(verb, options.source)->required();
  verb.add_option("--time", options.time_s,
                  "For a recording: the moment to draw in seconds of its clock, with tools, tips, proxies, "
                  "forces and the paths of the two seconds before")
      ->check(number_between(-1e9, 1e9))
      ->type_name("S");
  verb.add_option("--made-with", options.made_with,
                  "Scene file or volume of the recording; not needed for data sets")
      ->type_name("TARGET");
  verb.add_option("-o,--output", options.output,
                  "Picture to write (PNG); with --orbit an animated PNG, or a folder for the frames")
      ->required();
  verb.add_option_function<std::string>(
          "--from", [&options](const std::string& side) { options.request.from = kViews.at(side); },
          "Direction from which the picture is seen; default: anterior")
      ->check(CLI::IsMember(kViews))
      ->type_name("SIDE");
  verb.add_option(
          "--turn", options.request.turn_deg,
          "Rotation of the viewpoint around the body in degrees, from anterior over left to posterior")
      ->check(number_between(-360, 360))
      ->type_name("DEG");
  verb.add_option("--tilt", options.request.tilt_deg, "Elevation of the viewpoint in degrees")
      ->check(number_between(-90, 90))
      ->type_name("DEG");
  verb.add_flag("--perspective", options.request.perspective,
                "Perspective projection, without a scale bar; default: parallel projection");
  add_numbers(
      verb, "--at", options.at, 3, 1e6,
      "Point in the centre of the picture: patient coordinates in mm, LPS; default: the centre of the volume")
      ->type_name("X,Y,Z");
  verb.add_option_function<std::string>(
          "--cut", [&options](const std::string& side) { options.request.cut = kViews.at(side); },
          "Cut away everything on this side of the centre")
      ->check(CLI::IsMember(kViews))
      ->type_name("SIDE");
  verb.add_option("--size", options.request.size_mm,
                  "Width and height of the view in mm; default: the whole volume")
      ->check(number_between(1, 3000))
      ->type_name("MM");
  verb.add_option("--pixels", options.request.pixels, "Width and height of the picture in pixels")
      ->check(whole_between(kMinSectionPixels, kMaxSectionPixels))
      ->capture_default_str();
  verb.add_option("--only", options.only, "Draw only this structure; may be repeated")->type_name("NAME");
  verb.add_option("--hide", options.hide, "Leave out this structure; may be repeated")->type_name("NAME");
  verb.add_option("--scan-opacity", options.scan_opacity,
                  "Also draw the scan as a haze around the structures, with this opacity (up to 1)")
      ->check(number_between(0.05, 1))
      ->type_name("OPACITY");
  add_numbers(verb, "--window", options.window, 2, 1e9,
              "Scan values shown black and white; default: the 1st and 99th percentile")
      ->type_name("LOW,HIGH");
  verb.add_option("--orbit", options.frames,
                  "Number of pictures in a full turn around the body: an animated PNG if the output ends in "
                  ".png, otherwise a folder of frames")
      ->check(whole_between(2, kMaxFrames))
      ->type_name("N");
}

}  // namespace

void add_render(CLI::App& app, Run& run) {
  auto options = std::make_shared<RenderOptions>();
  CLI::App* verb = app.add_subcommand("render", "Draw the structures in three dimensions, as PNG");
  add_render_options(*verb, *options);
  verb->footer(
      "Examples:\n"
      "  palpate render knee-phantom -o knee.png\n"
      "  palpate render knee-phantom --from left --tilt 20 --perspective --cut left -o cut.png\n"
      "  palpate render STUDY structures.dcm -o study.png     a folder of DICOM and its segmentation\n"
      "  palpate render scene.toml --only femur --orbit 72 -o frames\n"
      "  palpate render scene.toml --scan-opacity 0.6 --window=-100,400 -o with-scan.png\n"
      "  palpate render knee-phantom --pixels 320 --orbit 48 -o orbit.png\n"
      "  palpate render run.h5 --time 3.2 -o moment.png\n\n"
      "Colours and opacities are the scene's (docs/guide/render.md).");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return render(*options, console); }; });
}

}  // namespace palpate::app
