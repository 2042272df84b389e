#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <span>

#include "c/guard.h"
#include "palpate/loading/loading.h"
#include "palpate/model/changed_model.h"

namespace palpate::c {

/// Method of a plp_method; empty: PLP_DEFAULT_METHOD. Error kBadInput for any other number.
Result<std::optional<ForceMethod>> method_of(std::int32_t method);

}  // namespace palpate::c

struct plp_model {
  static constexpr palpate::c::Tag kTag = palpate::c::Tag::kModel;
  ~plp_model() { tag = palpate::c::Tag::kNone; }

  palpate::c::Tag tag = kTag;
  /// Scene with the current version. Without a file: a scene without tissues.
  palpate::LoadedScene loaded;
  std::shared_ptr<const palpate::Model> prepared;                     ///< As in ModelVersions
  std::shared_ptr<const int> family = std::make_shared<const int>();  ///< Equal for versions of one model
  palpate::ForceMethod method = palpate::ForceMethod::kProxy;         ///< Method of a session by default

  const palpate::Model& current() const { return *loaded.model; }

  mutable std::mutex mutex;  ///< Guards `ready`
  /// The version, with the methods that with_methods() was called for until now.
  mutable std::shared_ptr<const palpate::Model> ready;
};

namespace palpate::c {

/// The version with force methods prepared for it, which are kept for the next call. Errors: those of
/// prepared_for.
Result<std::shared_ptr<const Model>> with_methods(const plp_model& model,
                                                  std::span<const ForceMethod> methods);

}  // namespace palpate::c
