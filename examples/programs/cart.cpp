// A cart's own program: a line of JSON for each sample comes in, a line with the input goes out.
// It gives the bits of cart.py:
//
// g++ -O2 -ffp-contract=off -o cart examples/programs/cart.cpp
// phalanx run warehouse --set 'agents.0.program=["./cart"]' --set agents.0.filter=true

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <string>
#include <vector>

const double RADIUS = 0.1, TRACK = 0.5, OFFSET = 0.25;  // of the wheels, between them, ahead [m]

// The numbers of the first list with this name, from a place in the line on.
std::vector<double> numbers(const std::string& line, const std::string& name, size_t from = 0) {
    std::vector<double> found;
    const char* at = line.c_str() + line.find("\"" + name + "\":[", from) + name.size() + 3;
    while (*at != ']') {
        char* end;
        found.push_back(std::strtod(at + 1, &end));  // past the bracket, or a comma
        at = end;
    }
    return found;
}

int main() {
    std::string line;
    while (std::getline(std::cin, line)) {
        const auto x = numbers(line, "x");
        const size_t goal = line.find("\"goal\"");
        const auto place = numbers(line, "position", goal), speed = numbers(line, "velocity", goal);
        const double ahead = std::cos(x[2]), aside = std::sin(x[2]);
        const double towards[] = {place[0] - (x[0] + OFFSET * ahead),
                                  place[1] - (x[1] + OFFSET * aside)};
        const double velocity[] = {speed[0] + towards[0], speed[1] + towards[1]};
        const double forward = ahead * velocity[0] + aside * velocity[1];
        const double turn = (ahead * velocity[1] - aside * velocity[0]) / OFFSET;
        std::printf("{\"u\": [%.17g, %.17g]}\n", (forward - turn * TRACK / 2) / RADIUS,
                    (forward + turn * TRACK / 2) / RADIUS);
        std::fflush(stdout);
    }
}
