#include "scene_options.h"

#include <cmath>
#include <cstdio>

#include "apps/command/text.h"
#include "palpate/volume_io/volume_io.h"

namespace palpate::app {

Result<LoadedScene> load_target(const SceneSource& source, Console& console,
                                std::optional<PreparationMethod> preparation,
                                const MemoryCallback& report_memory) {
  auto loaded =
      load_scene_or_data_set(source, console.progress(), console.warn(), preparation, report_memory);
  if (loaded && !loaded->proposed.empty()) console.note(loaded->proposed);
  if (loaded && loaded->label_placement) console.note(in_words(*loaded->label_placement) + ".");
  if (loaded && !loaded->origin_of_names.empty()) console.note(loaded->origin_of_names);
  return loaded;
}

Result<LoadedScene> load_touchable_target(const SceneSource& source, Console& console,
                                          std::optional<PreparationMethod> preparation,
                                          const MemoryCallback& report_memory) {
  auto loaded = load_target(source, console, preparation, report_memory);
  if (!loaded) return loaded;
  if (auto touchable = require_touchable_tissue(*loaded); !touchable) return touchable.error();
  return loaded;
}

Result<std::optional<Script>> script_of(const std::optional<std::filesystem::path>& file) {
  if (!file) return std::optional<Script>();
  auto script = load_script(*file);
  if (!script) return script.error();
  return std::optional(*std::move(script));
}

void add_method_option(CLI::App& verb, const std::string& help, std::span<const ForceMethodInfo> methods,
                       std::optional<ForceMethod>& method) {
  std::vector<std::string> names;
  for (const ForceMethodInfo& info : methods) names.emplace_back(info.name);
  verb.add_option_function<std::string>(
          "--method", [&method](const std::string& name) { method = find_force_method(name); }, help)
      ->check(CLI::IsMember(names));
}

void add_volume_option(CLI::App& verb, std::optional<int>& volume) {
  verb.add_option(
          "--volume", volume,
          "Number of the volume in a DICOM file or folder with several volumes (palpate info lists them)")
      ->check(whole_between(1, 100'000));
}

void add_content_options(CLI::App& verb) {
  CLI::Option* labels = verb.add_flag_callback(
      "--labels", [] { set_read_as(ReadAs::kLabels); }, "Read the volume, the second of two, as labels");
  verb.add_flag_callback(
          "--scan", [] { set_read_as(ReadAs::kScan); }, "Read the volume, the first of two, as a scan")
      ->excludes(labels);
}

void add_names_option(CLI::App& verb, std::optional<std::filesystem::path>& names) {
  verb.add_option("-n,--names", names,
                  "Names and colours of the labels (.ctbl, .txt, .tsv, .csv, .json, .label)");
}

CLI::Option* add_source_options(CLI::App& verb, SceneSource& source, const std::string& help) {
  CLI::Option* target = verb.add_option("target", source.target, help);
  verb.add_option(
      "segmentation", source.segmentation,
      "Segmentation of the scan, in either order; default: the only segmentation in a DICOM folder");
  add_names_option(verb, source.names);
  add_volume_option(verb, source.volume);
  add_content_options(verb);
  return target;
}

void add_preparation_option(CLI::App& verb, std::optional<PreparationMethod>& preparation) {
  verb.add_option_function<std::string>(
          "--preparation",
          [&preparation](const std::string& name) {
            preparation =
                name == "inward-ramp" ? PreparationMethod::kInwardRamp : PreparationMethod::kUnionGaussian;
          },
          "Method of preparation; default: the scene's")
      ->check(CLI::IsMember({"inward-ramp", "union-gaussian"}));
}

void print_touches(const std::vector<TouchFigure>& touches) {
  for (const TouchFigure& touch : touches)
    std::printf("line %d touched %s at %.1f, %.1f, %.1f mm\n", touch.line, touch.structure.c_str(),
                touch.point.x(), touch.point.y(), touch.point.z());
}

std::string hold_definition() {
  return "\"held\" is the longest uninterrupted time in which a structure was touched with a force within\n" +
         std::to_string(std::lround(100 * kHoldTolerance)) +
         " % of a force that the script presses it with (with any force if the script does not press it). A\n"
         "failed step is reported; the hand withdraws, and the run continues with\n"
         "the next approach.";
}

void print_removed(const std::vector<RemovedFigure>& removed) {
  for (const RemovedFigure& figure : removed)
    std::printf("removed %.1f mm3 of %s\n", figure.volume_mm3, figure.structure.c_str());
}

void print_protected(const std::vector<ProtectedFigure>& figures, const std::string& cutter) {
  for (const ProtectedFigure& figure : figures) {
    const char* name = figure.structure.c_str();
    if (figure.removed_mm3 > 0)
      std::printf("ALARM: %.1f mm3 removed from %s, which is protected\n", figure.removed_mm3, name);
    else if (figure.nearest_mm)
      std::printf("nearest distance to %s: %.2f mm; nothing was removed from it\n", name, *figure.nearest_mm);
    else
      std::printf("the %s was never near %s\n", cutter.c_str(), name);
  }
}

void print_holds(const std::vector<HoldFigure>& holds) {
  constexpr std::size_t kNameWidth = 28;
  std::printf("%s %8s %8s %8s\n", pad_or_truncate("structure", kNameWidth).c_str(), "held s", "mean N",
              "peak N");
  for (const HoldFigure& hold : holds)
    std::printf("%s %8.2f %8.2f %8.2f\n", pad_or_truncate(hold.structure, kNameWidth).c_str(), hold.held_s,
                hold.mean_force_N, hold.peak_force_N);
}

}  // namespace palpate::app
