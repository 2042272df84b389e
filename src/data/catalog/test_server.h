#pragma once

#include <gtest/gtest.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>

extern char** environ;

namespace palpate::test {

/// Sets an environment variable during the lifetime of the object.
class ScopedEnvironment {
 public:
  ScopedEnvironment(const char* name, const char* value) : name_(name) {
    if (const char* old = std::getenv(name)) old_ = old;
    value == nullptr ? ::unsetenv(name) : ::setenv(name, value, 1);
  }
  ScopedEnvironment(const ScopedEnvironment&) = delete;
  ScopedEnvironment& operator=(const ScopedEnvironment&) = delete;
  ~ScopedEnvironment() { old_ ? ::setenv(name_, old_->c_str(), 1) : ::unsetenv(name_); }

 private:
  const char* name_;
  std::optional<std::string> old_;
};

/// Runs test_server.py on a free loopback port; it ends when its standard input closes.
class TestServer {
 public:
  explicit TestServer(const std::filesystem::path& folder) {
    std::array<int, 2> to{}, from{};
    EXPECT_EQ(::pipe(to.data()) + ::pipe(from.data()), 0);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, to[0], 0);
    posix_spawn_file_actions_adddup2(&actions, from[1], 1);
    for (const int fd : {to[0], to[1], from[0], from[1]}) posix_spawn_file_actions_addclose(&actions, fd);
    std::string python = "python3", script = PALPATE_SOURCE_DIR "/src/data/catalog/test_server.py";
    std::string root = folder.string();
    std::array<char*, 4> arguments{python.data(), script.data(), root.data(), nullptr};
    if (::posix_spawnp(&process_, "python3", &actions, nullptr, arguments.data(), environ) != 0) process_ = 0;
    posix_spawn_file_actions_destroy(&actions);
    ::close(to[0]);
    ::close(from[1]);
    input_ = to[1];

    // the server prints its port on the first line
    char c = 0;
    while (process_ != 0 && ::read(from[0], &c, 1) == 1 && c != '\n') port_ += c;
    ::close(from[0]);
  }
  TestServer(const TestServer&) = delete;
  TestServer& operator=(const TestServer&) = delete;
  ~TestServer() {
    ::close(input_);
    if (process_ == 0) return;
    int status = 0;
    ::waitpid(process_, &status, 0);
  }

  bool running() const { return !port_.empty(); }
  /// "http://127.0.0.1:PORT/BEHAVIOUR"
  std::string url(const std::string& behaviour) const {
    return "http://127.0.0.1:" + port_ + "/" + behaviour;
  }

 private:
  pid_t process_ = 0;
  int input_ = -1;
  std::string port_;
};

}  // namespace palpate::test
