#include "servo/model_slot.h"

#include <algorithm>
#include <limits>
#include <string>
#include <utility>

#include "palpate/base/check.h"

namespace palpate {
namespace {

constexpr std::uint64_t kNever = std::numeric_limits<std::uint64_t>::max();

}  // namespace

ModelSlot::ModelSlot(std::shared_ptr<const Model> model) : current_(model.get()) {
  PALPATE_CHECK(model != nullptr);
  retired_.push_back({std::move(model), kNever});
}

Result<void> ModelSlot::set(std::shared_ptr<const Model> model) {
  const std::lock_guard lock(mutex_);
  if (model == nullptr)
    return Error{ErrorKind::kBadInput, "the model is null", "model", "give the model's next version"};
  const std::uint32_t current = retired_.back().model->version;
  if (model->version < current)
    return Error{ErrorKind::kBadInput,
                 "version " + std::to_string(model->version) + " is lower than version " +
                     std::to_string(current) + ", which the loop has",
                 "model", "make the next version of the loop's model"};
  const Model* next = model.get();
  // before the exchange, because it may throw for lack of memory: the servo's pointer must always be owned
  retired_.push_back({std::move(model), kNever});
  current_.store(next);
  retired_[retired_.size() - 2].free_from = begun_.load();
  collect_locked();
  return {};
}

std::size_t ModelSlot::collect() {
  const std::lock_guard lock(mutex_);
  return collect_locked();
}

std::size_t ModelSlot::collect_locked() {
  const std::uint64_t done = done_.load();
  std::erase_if(retired_, [&](const Retired& retired) { return retired.free_from <= done; });
  return retired_.size();
}

}  // namespace palpate
