#pragma once

#include <optional>
#include <string>

#include "palpate/loading/loading.h"

namespace palpate {

/// A scene with its volumes read, before its model is built.
struct ReadScene {
  Scene scene;
  SceneVolumes volumes;
  std::string data_set = {}, proposed = {}, origin_of_names = {}, names_from = {};  ///< As in LoadedScene
};

/// Source that errors name for a scene which is compiled into the program.
std::string embedded_source(const std::string& data_set);

/// Overrides the preparation method of a scene; empty: leaves it.
void prepare_by(std::optional<PreparationMethod> method, PreparationSettings& preparation);

/// Generates a phantom, with the scene of its kind.
/// @param what         name with parameters: "knee-phantom:side=right"
/// @param preparation  overrides the method of the scene
/// Errors: those of parse_phantom and make_phantom.
Result<ReadScene> read_phantom(const std::string& what, const Progress& progress,
                               std::optional<PreparationMethod> preparation);

/// Builds the model. Errors: those of build_model.
Result<LoadedScene> with_model(ReadScene read, const Progress& progress, const Warn& warn,
                               const MemoryCallback& report_memory);

}  // namespace palpate
