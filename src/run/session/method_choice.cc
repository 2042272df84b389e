#include "session/method_choice.h"

#include <exception>
#include <mutex>
#include <new>
#include <string>
#include <utility>

#include "palpate/base/reading.h"
#include "palpate/base/reason.h"
#include "palpate/direct/direct_methods.h"
#include "palpate/palpation/logged_loop.h"
#include "session/refusal.h"

namespace palpate {
namespace {

Error preparation_failed(const std::exception& why) {
  return {ErrorKind::kUnavailable,
          std::string("the fields of the direct methods could not be prepared: ") + reason_of(why), "",
          "continue with the proxy, or close other programs to free memory"};
}

std::array<bool, kForceMethods.size()> choosable_methods(const Model& model) {
  std::array<bool, kForceMethods.size()> choosable{};
  // fields of the direct methods are not updated when a burr removes material
  for (const ForceMethodInfo& info : kDirectMethods)
    choosable[index_of(info.method)] = !model.has_burr() && check_force_field(model, info.method).ok();
  choosable[index_of(ForceMethod::kProxy)] = model.has(ForceMethod::kProxy);
  return choosable;
}

}  // namespace

Error fields_for_other_stiffness() {
  return refusal("the fields of the direct methods were prepared for other stiffness values", "method",
                 "restore the initial stiffness of the tissues, or use inward ramps in the scene");
}

MethodChoice::MethodChoice(LiveModel& model, SessionLoop& loop, NewFields rebuild_fields,
                           MoreMethods prepare_methods, Wake wake)
    : model_(model),
      loop_(loop),
      rebuild_fields_(std::move(rebuild_fields)),
      prepare_methods_(std::move(prepare_methods)),
      wake_(std::move(wake)),
      choosable_(choosable_methods(model.current(model.lock()))),
      first_(model.versions(model.lock()).current) {}

bool MethodChoice::is_available(const LiveModel::Lock& lock, ForceMethod method) const {
  if (!is_choosable(method)) return false;
  const auto& [current, prepared] = model_.versions(lock);
  return current->has(method) && (method == ForceMethod::kProxy || fields_match(*current, *prepared));
}

bool MethodChoice::can_be_prepared(const LiveModel::Lock& lock, ForceMethod method) const {
  const auto& [current, prepared] = model_.versions(lock);
  return is_available(lock, method) || fields_match(*current, *prepared) || can_compute_fields(*current);
}

Result<void> MethodChoice::choose(const LiveModel::Lock& lock, ForceMethod method, RequestedBy by) {
  awaited_.reset();
  failure_.reset();
  if (is_available(lock, method)) {
    change_logged(*loop_.get(), loop_.log(), by, [&](Parameters& parameters) { parameters.method = method; });
    return {};
  }
  if (auto woken = wake_(lock); !woken) return woken;
  awaited_ = method;
  awaited_by_ = by;
  return {};
}

void MethodChoice::choose_next() {
  ServoLoop* loop = loop_.get();
  if (!loop) return;
  const LiveModel::Lock lock = model_.lock();
  const ForceMethod now = awaited_.value_or(loop->parameters().method);
  const auto possible = [&](ForceMethod method) {
    return is_choosable(method) && can_be_prepared(lock, method);
  };
  ForceMethod next = next_of(now);
  while (next != now && !possible(next)) next = next_of(next);
  if (auto chosen = choose(lock, next, {Originator::kKey}); !chosen) abandon(lock, next, chosen.error());
}

void MethodChoice::follow_script() {
  ServoLoop* loop = loop_.get();
  if (!loop) return;
  const ForceMethod method = loop->parameters().method;
  // the lock may be contended; the next call follows soon
  const LiveModel::Lock lock = model_.try_lock();
  if (!lock || awaited_ || is_available(lock, method) || !first_->has(method)) return;
  if (!can_be_prepared(lock, method))
    abandon(lock, method, fields_for_other_stiffness());
  else if (failure_ && abandoned_ == model_.current(lock).version)
    abandon(lock, method, *failure_);
  else if (auto chosen = choose(lock, method, {Originator::kScript}); !chosen)
    abandon(lock, method, chosen.error());
}

void MethodChoice::prepare(LiveModel::Lock& lock, const Progress& progress) {
  const ModelVersions versions = model_.versions(lock);
  const ForceMethod method = *awaited_;
  // unlock: a thread waiting for the lock would inherit this thread's low priority as latency
  lock.unlock();
  const auto ready = fields_for(method, versions, progress);
  lock.lock();
  // the model changed meanwhile: another version, and possibly other fields, are needed
  const bool is_outdated = model_.versions(lock).current != versions.current;
  if (!is_outdated || !awaited_) fields_ = nullptr;
  if (is_outdated) return;
  auto used = ready ? use_fields(lock, *ready) : Result<void>(ready.error());
  // another method may have been requested meanwhile
  if (!used && awaited_ == method) abandon(lock, method, used.error());
}

// Returns a model whose fields match the current stiffnesses and that is prepared for `method`. The result of
// an earlier attempt, fields_, is reused if it matches.
Result<std::shared_ptr<const Model>> MethodChoice::fields_for(ForceMethod method,
                                                              const ModelVersions& versions,
                                                              const Progress& progress) try {
  if (!fields_ || !fields_match(*versions.current, *fields_)) {
    fields_ = versions.prepared;
    if (!fields_match(*versions.current, *versions.prepared)) {
      auto made = rebuild_fields_(*versions.current, *versions.prepared, progress);
      if (!made) return made.error();
      fields_ = *std::move(made);
    }
  }
  // running out of memory would end the session, so the demand is checked first
  if (!fields_->has(method))
    if (auto allowed = check_memory(memory_of_force_field(*fields_, method), std::string(name_of(method)));
        !allowed)
      return allowed.error();
  auto more = prepare_methods_(fields_, {&method, 1}, progress);
  if (more) fields_ = *more;
  return more;
} catch (const std::exception& why) {
  return preparation_failed(why);
}

Result<void> MethodChoice::use_fields(const LiveModel::Lock& lock, std::shared_ptr<const Model> fields) try {
  const auto& [current, prepared] = model_.versions(lock);
  if (fields_match(*current, *prepared)) {
    // preparing further methods leaves the haptic properties unchanged, so no new version is needed
    auto next = std::make_shared<Model>(*current);
    next->field = fields->field;
    next->methods = fields->methods;
    model_.set_prepared(lock, {std::move(next), std::move(fields)});
  } else {
    const auto next = with_fields(*current, *fields);
    model_.apply(lock, {next, next}, {next->version, ModelChange::kFieldsRebuilt}, awaited_by_);
  }
  return awaited_ && is_available(lock, *awaited_) ? choose(lock, *awaited_, awaited_by_) : Result<void>();
} catch (const std::exception& why) {
  return preparation_failed(why);
}

// keeps the current method and reports the error to the requester
void MethodChoice::abandon(const LiveModel::Lock& lock, ForceMethod method, Error why) {
  const Model& model = model_.current(lock);
  awaited_.reset();
  abandoned_ = model.version;
  why.where = name_of(method);
  failure_ = std::move(why);
  // a script may have selected the method before its fields were generated: fall back to the proxy
  change_logged(*loop_.get(), loop_.log(), {}, [&](Parameters& parameters) {
    if (parameters.method == method && model.has(ForceMethod::kProxy))
      parameters.method = ForceMethod::kProxy;
  });
}

void MethodChoice::abandon_without_memory(const LiveModel::Lock& lock) noexcept {
  abandoned_ = model_.current(lock).version;
  if (!awaited_) return;
  try {
    failure_.emplace(Error{ErrorKind::kUnavailable, "out of memory", "", ""}).where = name_of(*awaited_);
  } catch (const std::bad_alloc&) {
    // the request ends without a reason
  }
  awaited_.reset();
}

std::optional<ForceMethod> MethodChoice::awaited() const {
  const LiveModel::Lock lock = model_.lock();
  return awaited_;
}

std::optional<Error> MethodChoice::failure() const {
  const LiveModel::Lock lock = model_.lock();
  return failure_;
}

void MethodChoice::describe(const LiveModel::Lock& /*held*/, ViewedState& state) const {
  if (awaited_) state.method_awaited = name_of(*awaited_);
  state.method_failure = failure_;
}

}  // namespace palpate
