#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "input_files.h"
#include "palpate/base/output.h"
#include "palpate/palpation/palpation.h"
#include "palpate/rendering/rendering.h"
#include "scene_options.h"
#include "verb.h"

namespace palpate::app {
namespace {

struct ForcesOptions {
  SceneSource source;
  std::string plane = "axial";
  std::filesystem::path output;
  std::optional<ForceMethod> method;
  std::optional<PreparationMethod> preparation;
  std::vector<double> at;
  double size_mm = 20;
  std::optional<double> spacing_mm;
};

AnatomicalPlane plane_of(const std::string& name) {
  if (name == "coronal") return AnatomicalPlane::kCoronal;
  return name == "sagittal" ? AnatomicalPlane::kSagittal : AnatomicalPlane::kAxial;
}

// point where an approach would touch the first reachable structure
Result<Point<Patient>> section_centre(const Model& model) {
  for (const Segment& segment : model.segments) {
    if (!model.is_touchable(segment.id)) continue;
    if (const auto found = find_surface_point(model, segment.id, ApproachStep{}.clearance_mm))
      return found->point;
  }
  return Error{ErrorKind::kBadInput, "no structure of the scene has a surface that can be touched", "",
               "give a point with --at"};
}

// names the option from which a refused position or spacing came
Error at_option(Error error) {
  if (error.where == "centre") error.where = "--at";
  if (error.where == "spacing") error.where = "--arrows";
  return error;
}

int draw_forces(const ForcesOptions& options, Console& console) {
  const auto claimed = claim_output(options.output, input_files(options.source));
  if (!claimed) return console.fail(claimed.error());
  if (const auto extension = options.output.extension(); !extension.empty() && extension != ".svg")
    return console.fail({ErrorKind::kUsage, "the output is an SVG picture", options.output.string(),
                         "give it a name that ends in .svg"});
  const Progress progress = console.progress();
  const auto loaded = load_touchable_target(options.source, console, options.preparation);
  if (!loaded) return console.fail(loaded.error());
  // the force of the proxy depends on the path of the tip, so it has no force field
  const ForceMethod of_scene = loaded->scene.force.method;
  const ForceMethod method =
      options.method.value_or(of_scene == ForceMethod::kProxy ? ForceMethod::kTrilinear : of_scene);
  const auto model = prepared_with_cache(loaded->model, std::array{method}, progress);
  if (!model) return console.fail(model.error());

  ForceArrowsRequest request;
  request.plane = plane_of(options.plane);
  request.size_mm = options.size_mm;
  request.spacing_mm = options.spacing_mm.value_or(0);
  if (options.at.empty()) {
    const auto centre = section_centre(**model);
    if (!centre) return console.fail(centre.error());
    request.centre = *centre;
  } else {
    request.centre = {options.at[0], options.at[1], options.at[2]};
  }
  const auto written = write_force_arrows(options.output, **model, method, request, progress);
  if (!written) return console.fail(at_option(written.error()));
  console.note("picture: " + options.output.string());
  return kExitOk;
}

}  // namespace

void add_forces(CLI::App& app, Run& run) {
  auto options = std::make_shared<ForcesOptions>();
  CLI::App* verb = app.add_subcommand("forces", "Draw a force method's arrows over a section, as SVG");
  add_source_options(*verb, options->source)->required();
  verb->add_option("-o,--output", options->output, "Picture to write (SVG)")->required();
  add_method_option(*verb, "Force method; default: the scene's, or trilinear if that is the proxy",
                    kDirectMethods, options->method);
  add_preparation_option(*verb, options->preparation);
  verb->add_option("--plane", options->plane, "Section through the point")
      ->check(CLI::IsMember({"axial", "coronal", "sagittal"}))
      ->capture_default_str();
  verb->add_option("--at", options->at,
                   "Centre of the picture: patient coordinates in mm, LPS; default: the point at which "
                   "a simulated hand touches the first touchable structure")
      ->delimiter(',')
      ->expected(3)
      ->check(number_between(-1e6, 1e6))
      ->type_name("X,Y,Z");
  verb->add_option("--size", options->size_mm, "Width of the section in mm")
      ->check(number_between(0.1, 1000))
      ->capture_default_str();
  verb->add_option("--arrows", options->spacing_mm,
                   "Distance between arrows in mm; default: 24 arrows across the section")
      ->check(number_between(0.001, 1000));
  verb->footer(
      "Examples:\n"
      "  palpate forces knee-phantom -o forces.svg\n"
      "  palpate forces knee-phantom --method gaussian-sphere --plane sagittal --at 20,-2,0 -o gap.svg\n\n"
      "docs/concepts/methods.md shows one picture per method.");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return draw_forces(*options, console); }; });
}

}  // namespace palpate::app
