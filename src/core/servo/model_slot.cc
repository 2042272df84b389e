#include "servo/model_slot.h"

#include <algorithm>
#include <limits>

#include "palpate/base/check.h"

namespace palpate {
namespace {

constexpr std::uint64_t kNever = std::numeric_limits<std::uint64_t>::max();

}  // namespace

ModelSlot::ModelSlot(std::shared_ptr<const Model> model) : current_(model.get()) {
  PALPATE_CHECK(model != nullptr);
  held_.push_back({std::move(model), kNever});
}

void ModelSlot::set(std::shared_ptr<const Model> model) {
  const std::lock_guard lock(mutex_);
  PALPATE_CHECK(model != nullptr);
  PALPATE_CHECK(model->version >= held_.back().model->version);
  const Model* next = model.get();
  // before the exchange, because it may throw for lack of memory: the servo's pointer must always be owned
  held_.push_back({std::move(model), kNever});
  current_.store(next);
  held_[held_.size() - 2].free_from = begun_.load();
  collect_locked();
}

std::size_t ModelSlot::collect() {
  const std::lock_guard lock(mutex_);
  return collect_locked();
}

std::size_t ModelSlot::collect_locked() {
  const std::uint64_t done = done_.load();
  std::erase_if(held_, [&](const Held& held) { return held.free_from <= done; });
  return held_.size();
}

}  // namespace palpate
