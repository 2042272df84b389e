#pragma once

#include <array>
#include <memory>
#include <utility>

#include "palpate/loading/loading.h"

namespace palpate::app {

/// Model for writing a report. If it can be cut it is made ready for the proxy, because the depth of a burr
/// is reported below the surfaces that the proxy uses. Errors: those of prepared_with_cache.
inline Result<std::shared_ptr<const Model>> report_model(std::shared_ptr<const Model> model,
                                                         const Progress& progress) {
  if (!model->has_burr()) return model;
  constexpr std::array kProxyAlone = {ForceMethod::kProxy};
  return prepared_with_cache(std::move(model), kProxyAlone, progress);
}

}  // namespace palpate::app
