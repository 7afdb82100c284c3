# One image for every program of a run: phalanx plant, phalanx agent NAME, phalanx viewer.
# `make base` puts the digest of the day behind the name.
ARG BASE=python:3.12-slim

FROM ${BASE} AS build
WORKDIR /src
RUN python3 -m venv /opt/phalanx
# What changes rarely first: a change of the code does not install the libraries again.
COPY locks/image.txt locks/image.txt
RUN /opt/phalanx/bin/pip install --no-cache-dir --require-hashes --requirement locks/image.txt
# CasADi's solver plugins and headers, and the libraries' own tests: half of the image, unused.
RUN cd /opt/phalanx/lib/python3*/site-packages \
 && find casadi -mindepth 1 -maxdepth 1 \
      ! -name '*.py' ! -name '_casadi.so' ! -name 'libcasadi.so*' -exec rm -rf {} + \
 && find . -name tests -type d -prune -exec rm -rf {} +
COPY pyproject.toml hatch_build.py README.md LICENSE ./
COPY phalanx phalanx
COPY agent agent
COPY plant plant
COPY viewer viewer
COPY scenarios scenarios
COPY packages/phalanx-hosts packages/phalanx-hosts
RUN /opt/phalanx/bin/pip install --no-cache-dir --no-deps --no-build-isolation . ./packages/phalanx-hosts

FROM ${BASE}
COPY --from=build /opt/phalanx /opt/phalanx
RUN useradd --uid 10001 --no-create-home --shell /usr/sbin/nologin phalanx \
 && install --directory --owner=phalanx /runs
ENV PATH=/opt/phalanx/bin:$PATH \
    OPENBLAS_NUM_THREADS=1 \
    MPLCONFIGDIR=/tmp \
    PYTHONUNBUFFERED=1
USER phalanx
WORKDIR /runs
ENTRYPOINT ["phalanx"]
CMD ["--help"]
