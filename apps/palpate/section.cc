#include <memory>
#include <optional>
#include <vector>

#include "attachment.h"
#include "input_files.h"
#include "palpate/base/output.h"
#include "palpate/loading/loading.h"
#include "palpate/rendering/rendering.h"
#include "palpate/volume_io/dicom_export.h"
#include "scene_options.h"
#include "verb.h"

namespace palpate::app {
namespace {

struct SectionOptions {
  SceneSource source;
  std::string view = "along";
  std::optional<std::string> plane;
  std::filesystem::path output;
  std::vector<double> at, direction, window;
  std::optional<double> size_mm;
  int pixels = SectionRequest{}.pixels;
  double opacity = SectionStyle{}.label_opacity;
  bool fill = false, outline = false, keep_identifiers = false;
};

SectionKind kind_of(const SectionOptions& options) {
  if (!options.plane) return options.direction.empty() ? SectionKind::kThree : SectionKind::kOblique;
  if (*options.plane == "axial") return SectionKind::kAxial;
  if (*options.plane == "coronal") return SectionKind::kCoronal;
  if (*options.plane == "sagittal") return SectionKind::kSagittal;
  return *options.plane == "oblique" ? SectionKind::kOblique : SectionKind::kThree;
}

Result<OutputClaim> check_section(const SectionOptions& options) {
  const auto usage = [](std::string what, std::string where, std::string remedy) {
    return Error{ErrorKind::kUsage, std::move(what), std::move(where), std::move(remedy)};
  };
  auto claimed = claim_output(options.output, input_files(options.source));
  if (!claimed) return claimed;
  const auto extension = options.output.extension();
  if (!extension.empty() && extension != ".png" && extension != ".dcm")
    return usage("the output is a PNG picture or a DICOM Secondary Capture", options.output.string(),
                 "give it a name that ends in .png or .dcm");
  if (options.keep_identifiers && extension != ".dcm")
    return usage("only DICOM can keep identifiers", "--keep-identifiers",
                 "write a file that ends in .dcm, or leave it out");
  const bool oblique = kind_of(options) == SectionKind::kOblique;
  if (oblique && options.direction.empty())
    return usage("an oblique section needs a direction", "--plane", "give it with --direction X,Y,Z");
  if (!oblique && !options.direction.empty())
    return usage("only an oblique section has a direction", "--direction", "leave out --plane");
  if (oblique && options.direction == std::vector<double>{0, 0, 0})
    return usage("0,0,0 is not a direction", "--direction", "give a vector in patient coordinates, LPS");
  if (!options.window.empty() && !(options.window[0] < options.window[1]))
    return usage("the lower end of the window must be below the upper end", "--window", "give LOW,HIGH");
  return claimed;
}

SectionRequest request_of(const SectionOptions& options, const GridGeometry& grid) {
  SectionRequest request;
  request.kind = kind_of(options);
  request.centre =
      options.at.empty() ? grid.centre() : Point<Patient>(options.at[0], options.at[1], options.at[2]);
  if (const auto& d = options.direction; !d.empty()) request.direction = {d[0], d[1], d[2]};
  request.view = options.view == "across" ? ObliqueView::kAcross : ObliqueView::kAlong;
  request.size_mm = options.size_mm.value_or(0);
  request.pixels = options.pixels;
  request.style.label_opacity = options.outline ? 0 : options.opacity;
  request.style.outlines = !options.fill;
  if (!options.window.empty()) {
    request.style.window_low = options.window[0];
    request.style.window_high = options.window[1];
  }
  return request;
}

int draw_section(const SectionOptions& options, Console& console) {
  const auto claimed = check_section(options);
  if (!claimed) return console.fail(claimed.error());
  const auto loaded = load_target(options.source, console);
  if (!loaded) return console.fail(loaded.error());
  const auto attached = attachment_of(*loaded, options.keep_identifiers);
  if (!attached) return console.fail(attached.error());
  const Model& model = *loaded->model;
  const auto picture = section_picture(model, request_of(options, model.labels->geometry()));
  if (!picture) {
    Error error = picture.error();
    if (error.where == "centre") error.where = "--at";
    return console.fail(error);
  }
  const auto written = options.output.extension() == ".dcm"
                           ? write_secondary_capture(options.output, picture->width, picture->height,
                                                     picture->rgb, "Section", *attached, console.progress())
                           : write_png(options.output, *picture);
  if (!written) return console.fail(written.error());
  console.note("picture: " + options.output.string());
  return kExitOk;
}

void add_section_options(CLI::App& verb, SectionOptions& options) {
  add_source_options(verb, options.source)->required();
  verb.add_option("-o,--output", options.output, "Picture to write: .png, or .dcm (DICOM Secondary Capture)")
      ->required();
  add_numbers(verb, "--at", options.at, 3, 1e6,
              "Point in the section: patient coordinates in mm, LPS; default: the centre of the volume")
      ->type_name("X,Y,Z");
  verb.add_option(
          "--plane", options.plane,
          "Section through the point; three: axial, coronal and sagittal side by side; default: three, "
          "with --direction oblique")
      ->check(CLI::IsMember({"axial", "coronal", "sagittal", "oblique", "three"}));
  add_numbers(
      verb, "--direction", options.direction, 3, 1e6,
      "Direction of an oblique section, such as that of a tool or a force, in patient coordinates, LPS")
      ->type_name("X,Y,Z");
  verb.add_option("--view", options.view,
                  "Orientation of an oblique section: along the direction, which points down in the picture, "
                  "or across it, seen along the direction")
      ->check(CLI::IsMember({"along", "across"}))
      ->capture_default_str();
  verb.add_option("--size", options.size_mm,
                  "Width and height of the section in mm; default: the longest side of the volume")
      ->check(number_between(1, 1000));
  verb.add_option("--pixels", options.pixels,
                  "Width and height of the picture, or of each of the three, in pixels")
      ->check(whole_between(kMinSectionPixels, kMaxSectionPixels))
      ->capture_default_str();
  verb.add_flag("--keep-identifiers", options.keep_identifiers,
                "Attach a Secondary Capture to the study of the scan; default: no patient");
  CLI::Option* fill = verb.add_flag("--fill", options.fill, "Fill structures, without outlines");
  verb.add_flag("--outline", options.outline, "Outline structures, without filling them; default: both")
      ->excludes(fill);
  verb.add_option("--opacity", options.opacity, "Opacity of filled structures over the scan")
      ->check(number_between(0, 1))
      ->capture_default_str();
  add_numbers(verb, "--window", options.window, 2, 1e9,
              "Scan values shown black and white; default: the 1st and 99th percentile")
      ->type_name("LOW,HIGH");
}

}  // namespace

void add_section(CLI::App& app, Run& run) {
  auto options = std::make_shared<SectionOptions>();
  CLI::App* verb =
      app.add_subcommand("section", "Draw a section through scan and structures, as PNG or DICOM");
  add_section_options(*verb, *options);
  verb->footer(
      "Examples:\n"
      "  palpate section knee-phantom -o three.png\n"
      "  palpate section STUDY -o three.dcm                   for a PACS\n"
      "  palpate section STUDY structures.dcm -o three.png    a folder of DICOM and its segmentation\n"
      "  palpate section knee-phantom --plane coronal --at 20,0,0 --size 100 --outline -o coronal.png\n"
      "  palpate section scene.toml --at=-12,40,8 --direction=0.3,1,-0.2 --window=-160,240 -o oblique.png\n\n"
      "Radiological display convention: the patient's left is on the right (docs/guide/section.md).");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return draw_section(*options, console); }; });
}

}  // namespace palpate::app
