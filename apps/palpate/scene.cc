#include "palpate/scene/scene.h"
#include "palpate/scene/script.h"
#include "palpate/scene/tissue_presets.h"

#include <memory>

#include "scene_verbs.h"
#include "verb.h"

namespace palpate::app {
namespace {

void add_scene_keys(CLI::App& app, Run& run) {
  const auto script = std::make_shared<bool>(false);
  CLI::App* verb = app.add_subcommand("keys", "Print every key of a scene file as Markdown tables");
  verb->add_flag("--script", *script, "Print the keys of a palpation script instead");
  verb->footer("Examples:\n  palpate scene keys\n  palpate scene keys --script");
  verb->callback([script, &run] {
    run = [script](Console&) { return print_result(*script ? script_keys() : scene_keys()); };
  });
}

void add_scene_presets(CLI::App& app, Run& run) {
  CLI::App* verb =
      app.add_subcommand("presets", "Print every tissue preset with its values and their sources");
  verb->footer("Example: palpate scene presets");
  verb->callback([&run] {
    run = [](Console&) {
      return print_result("### Stiffness and friction\n\n" + tissue_preset_table() +
                          "\n### Elastic moduli\n\n" + elastic_preset_table() + "\n### Relaxation\n\n" +
                          relaxation_preset_table());
    };
  });
}

}  // namespace

void add_scene(CLI::App& app, Run& run) {
  CLI::App* verb = app.add_subcommand("scene", "Write or check a scene file, or list its keys and presets");
  verb->require_subcommand(1);
  verb->footer(
      "Examples:\n"
      "  palpate scene new scan.nii.gz labels.nii.gz -o scene.toml\n"
      "  palpate scene check scene.toml\n"
      "  palpate scene keys");
  add_scene_new(*verb, run);
  add_scene_check(*verb, run);
  add_scene_keys(*verb, run);
  add_scene_presets(*verb, run);
}

}  // namespace palpate::app
