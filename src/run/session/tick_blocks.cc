#include "session/tick_blocks.h"

#include <algorithm>
#include <utility>

#include "palpate/base/check.h"

namespace palpate {

TickBlocks::TickBlocks(Read read, std::vector<double> begins_s)
    : read_block_(std::move(read)), begins_s_(std::move(begins_s)) {
  PALPATE_CHECK(!begins_s_.empty());
  reader_ = std::thread([this] { this->read(); });
}

TickBlocks::~TickBlocks() {
  ending_ = true;
  {
    const std::lock_guard lock(mutex_);
    requested_changed_.notify_all();
  }
  reader_.join();
}

std::optional<TickRecord> TickBlocks::tick_at(double at_s, int direction, double from_s) {
  const std::size_t block = block_at(at_s);
  const std::lock_guard lock(mutex_);
  if (block != wanted_ || direction != direction_) {
    wanted_ = block;
    direction_ = direction;
    requested_changed_.notify_all();
  }
  const Block* ticks = find(block);
  if (ticks == nullptr) return nearest_played(block, direction, block_at(from_s));
  const auto next = std::ranges::upper_bound(*ticks, at_s, {}, &TickRecord::time_s);
  return *(next == ticks->begin() ? next : next - 1);
}

std::optional<TickRecord> TickBlocks::stored_at(std::uint64_t row) const {
  const std::lock_guard lock(mutex_);
  const auto found = std::ranges::find(stored_, row / kTicks, &CachedBlock::number);
  if (found == stored_.end() || row % kTicks >= found->ticks.size()) return std::nullopt;
  return found->ticks[row % kTicks];
}

std::optional<Error> TickBlocks::failure() const {
  const std::lock_guard lock(mutex_);
  return failure_;
}

void TickBlocks::try_again() {
  const std::lock_guard lock(mutex_);
  failure_.reset();
  requested_changed_.notify_all();
}

std::size_t TickBlocks::block_at(double at_s) const {
  const auto after = std::ranges::upper_bound(begins_s_, at_s);
  return after == begins_s_.begin() ? 0 : static_cast<std::size_t>(after - begins_s_.begin()) - 1;
}

const TickBlocks::Block* TickBlocks::find(std::size_t block) {
  const auto found = std::ranges::find(stored_, block, &CachedBlock::number);
  if (found == stored_.end()) return nullptr;
  stored_.splice(stored_.begin(), stored_, found);
  return &stored_.front().ticks;
}

bool TickBlocks::is_stored(std::size_t block) const {
  return std::ranges::find(stored_, block, &CachedBlock::number) != stored_.end();
}

std::optional<TickRecord> TickBlocks::nearest_played(std::size_t block, int direction,
                                                     std::size_t from) const {
  const CachedBlock* nearest = nullptr;
  for (const CachedBlock& stored : stored_) {
    const bool played = direction > 0   ? stored.number >= from && stored.number < block
                        : direction < 0 ? stored.number <= from && stored.number > block
                                        : false;
    if (played && (nearest == nullptr || (stored.number > nearest->number) == (direction > 0)))
      nearest = &stored;
  }
  if (nearest == nullptr) return std::nullopt;
  return direction > 0 ? nearest->ticks.back() : nearest->ticks.front();
}

// with the mutex locked
std::optional<std::size_t> TickBlocks::missing() const {
  if (failure_) return std::nullopt;
  if (!is_stored(wanted_)) return wanted_;
  if (direction_ > 0 && wanted_ + 1 < begins_s_.size() && !is_stored(wanted_ + 1)) return wanted_ + 1;
  if (direction_ < 0 && wanted_ > 0 && !is_stored(wanted_ - 1)) return wanted_ - 1;
  return std::nullopt;
}

void TickBlocks::read() {
  const Progress progress({}, &ending_);
  std::unique_lock lock(mutex_);
  while (!ending_) {
    const auto block = missing();
    if (!block) {
      requested_changed_.wait(lock);
      continue;
    }
    lock.unlock();
    auto ticks = read_block_(*block, progress);
    lock.lock();
    if (!ticks) {
      failure_ = ticks.error();
      continue;
    }
    // times are looked up by binary search in the block
    if (ticks->empty() || !std::ranges::is_sorted(*ticks, {}, &TickRecord::time_s) ||
        ticks->front().time_s != begins_s_[*block]) {
      failure_ = Error{ErrorKind::kBadInput, "the recording changed while it was open", "",
                       "open it again when no program writes to it"};
      continue;
    }
    stored_.push_front({*block, *std::move(ticks)});
    if (stored_.size() > kMaxStored) stored_.pop_back();
  }
}

}  // namespace palpate
