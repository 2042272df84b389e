#include "palpate/tissue/elastic_solver.h"

#include <gtest/gtest.h>
