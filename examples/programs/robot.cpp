// A robot's own program that knows its peers by radio: to the goal, keeping right of others.
// It gives the bits of robot.py:
//
// g++ -O2 -ffp-contract=off -o robot examples/programs/robot.cpp
// phalanx run radio --set 'agents.0.program=["./robot"]' --set agents.0.filter=true

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <string>
#include <vector>

const double NEAR = 4.0, GAIN = 1.0, DAMPING = 4.0, SPEED = 3.0, PUSH = 2.0;  // m, 1/s, m/s

// The numbers of the first list with this name, from a place in the line on.
std::vector<double> numbers(const std::string& line, const std::string& name, size_t from = 0) {
    std::vector<double> values;
    const char* at = line.c_str() + line.find("\"" + name + "\":[", from) + name.size() + 3;
    while (*at != ']') {
        char* end;
        values.push_back(std::strtod(at + 1, &end));  // past the bracket, or a comma
        at = end;
    }
    return values;
}

int main() {
    std::string line;
    while (std::getline(std::cin, line)) {
        const auto x = numbers(line, "x"), goal = numbers(line, "position");
        double wx = GAIN * (goal[0] - x[0]), wy = GAIN * (goal[1] - x[1]);
        const double share = SPEED / std::max(std::sqrt(wx * wx + wy * wy), SPEED);
        wx *= share, wy *= share;
        size_t at = line.find("\"peers\"");
        while ((at = line.find("\"x\":[", at)) != std::string::npos) {
            const auto peer = numbers(line, "x", at++);
            const double dx = peer[0] - x[0], dy = peer[1] - x[1];
            const double distance = std::sqrt(dx * dx + dy * dy);
            if (distance <= 0.0 || distance >= NEAR) continue;
            const double push = PUSH * (1.0 - distance / NEAR) / distance;
            wx += push * (dy - dx), wy -= push * (dx + dy);
        }
        std::printf("{\"u\": [%.17g, %.17g]}\n", DAMPING * (wx - x[2]), DAMPING * (wy - x[3]));
        std::fflush(stdout);
    }
}
