// edited_session FILE
//
// Explores the tests' ball on the real clock, edited five times a second, until it is killed. Says so by one
// byte on its standard output for each edit. For killed_session_test.cc.
#include "session/edited_session.h"

#include <unistd.h>

#include <chrono>
#include <cstdio>

#include "palpate/explore.h"
#include "session/test_session.h"

int main(int count, char** arguments) {
  using namespace palpate;
  using Clock = std::chrono::steady_clock;
  if (count != 2) {
    std::fprintf(stderr, "usage: edited_session FILE\n");
    return 2;
  }
  constexpr auto kPeriod = std::chrono::milliseconds(200);
  const auto script = parse_script(
      "[[step]]\napproach = \"ball\"\nspeed = 200.0\n[[step]]\npress = 0.8\n[[step]]\nhold = 60.0\n",
      "edited session");
  PALPATE_CHECK(script.ok());
  ViewerHost* host = nullptr;
  std::uint32_t edits = 0;
  Clock::time_point next = Clock::now();
  ExploreOptions options;
  options.loop.realtime = false;
  options.loop.ring_s = 30;
  options.viewers = [&](ViewerHost& session) -> Result<std::shared_ptr<void>> {
    host = &session;
    return std::shared_ptr<void>();
  };
  options.request = [&] {
    if (Clock::now() < next) return ExploreRequest::kNone;
    next = Clock::now() + kPeriod;
    PALPATE_CHECK(palpate::testing::ask_for_edit(*host, ++edits));
    PALPATE_CHECK(::write(STDOUT_FILENO, ".", 1) == 1);
    return ExploreRequest::kNone;
  };
  const auto explored = explore(palpate::testing::loaded_ball(), *script, options, arguments[1]);
  std::fprintf(stderr, "%s\n", explored ? "ended by itself" : explored.error().message().c_str());
  return 1;
}
