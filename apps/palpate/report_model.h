#pragma once

#include <array>
#include <memory>
#include <utility>

#include "palpate/loading/loading.h"

namespace palpate::app {

/// The model that a report is written of: how deep a burr got is told below the surfaces that the proxy leans
/// on. Errors: those of ready_for.
inline Result<std::shared_ptr<const Model>> report_model(std::shared_ptr<const Model> model,
                                                         const Progress& progress) {
  if (!model->cuts()) return model;
  constexpr std::array kProxyAlone = {ForceMethod::kProxy};
  return ready_for(std::move(model), kProxyAlone, progress);
}

}  // namespace palpate::app
