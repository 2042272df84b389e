#include <algorithm>
#include <utility>

#include "loading/cached_preparation.h"
#include "loading/read_scene.h"
#include "palpate/base/check.h"
#include "palpate/phantoms/phantoms.h"

namespace palpate {
namespace {

// sets the modulus of the tissue "nodule" to a multiple of that of "soft tissue"
void set_stiffness_of_nodules(double times, Scene& scene) {
  const auto named = [&](const char* name) -> ElasticConstants& {
    const auto found = std::ranges::find(scene.tissues, name, &TissueSettings::name);
    PALPATE_CHECK(found != scene.tissues.end() && found->elastic.has_value());
    return *found->elastic;
  };
  named("nodule").youngs_modulus_kPa = times * named("soft tissue").youngs_modulus_kPa;
}

// scene for a kind of phantom, extended by the tissues that its parameters add; tissues that they omit are
// optional
Result<Scene> scene_of_phantom(const std::string& name, const PhantomParameters& parameters) {
  std::string text(embedded_scene(name.substr(0, name.find(':'))).value());
  const auto* knee = std::get_if<KneeParameters>(&parameters);
  if (knee != nullptr && knee->lesion_mm > 0) text += *embedded_scene("lesion-in-knee");
  if (knee != nullptr && knee->burr_mm > 0)
    text +=
        "\n[tool]\nkind = \"burr\"\nspindle = [1, 0, 0]\ndiameter = " + std::to_string(knee->burr_mm) + "\n";
  auto scene = parse_scene(text, embedded_source(name));
  if (!scene) return scene;
  if (const NoduleParameters* nodules = nodule_parameters(parameters))
    set_stiffness_of_nodules(nodules->stiffness, *scene);
  if (const auto* bone = std::get_if<TemporalBoneParameters>(&parameters))
    scene->side = bone->side == BodySide::kLeft ? Side::kLeft : Side::kRight;
  if (name.find(':') != std::string::npos)
    for (TissueSettings& tissue : scene->tissues) tissue.optional = true;
  return scene;
}

}  // namespace

std::string embedded_source(const std::string& data_set) {
  return data_set + " (embedded scene)";
}

void prepare_by(std::optional<PreparationMethod> method, PreparationSettings& preparation) {
  if (!method) return;
  preparation.method = *method;
  if (*method != PreparationMethod::kInwardRamp) preparation.ramp_width_mm.reset();
}

Result<ReadScene> read_phantom(const std::string& what, const Progress& progress,
                               std::optional<PreparationMethod> preparation) {
  const auto parameters = parse_phantom(what);
  if (!parameters) return parameters.error();
  const std::string name = phantom_name(*parameters);
  auto scene = scene_of_phantom(name, *parameters);
  if (!scene) return scene.error();
  prepare_by(preparation, scene->preparation);
  auto phantom = cached_phantom(*parameters, progress);
  if (!phantom) return phantom.error();
  return ReadScene{
      *std::move(scene),
      {std::move(phantom->labels), std::make_shared<const Volume<float>>(std::move(phantom->scan)), true},
      name};
}

Result<LoadedScene> with_model(ReadScene read, const Progress& progress, const Warn& warn,
                               const MemoryCallback& report_memory) {
  const auto placement = read.volumes.label_placement;
  auto model = build_model(read.scene, std::move(read.volumes), progress, warn, report_memory);
  if (!model) return model.error();
  return LoadedScene{std::move(read.scene),     *std::move(model), std::move(read.data_set),
                     std::move(read.proposed),  placement,         std::move(read.origin_of_names),
                     std::move(read.names_from)};
}

}  // namespace palpate
