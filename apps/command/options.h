#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>
#include <vector>

/// Options whose values are checked.
namespace palpate::app {

/// For options with a number: finite, and from low to high, both included.
CLI::Validator number_between(double low, double high);
/// An option of so many numbers with commas between them, each from -most to most.
CLI::Option* add_numbers(CLI::App& verb, const std::string& name, std::vector<double>& numbers, int count,
                         double most, const std::string& help);
/// The same for whole numbers, written in digits alone.
CLI::Validator whole_between(std::uint64_t low, std::uint64_t high);

}  // namespace palpate::app
