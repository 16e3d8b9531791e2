# Debian 13 with what .ci/setup installs. Its lines have been run, `make demo` too, in a bare Debian 13 root; not by Docker itself.
#   docker build -t fenics_contact . && docker run --rm -v "$PWD/results:/fenics_contact/results" fenics_contact
FROM debian:trixie
RUN apt-get update -q && DEBIAN_FRONTEND=noninteractive apt-get install -qy --no-install-recommends ca-certificates git make
COPY .ci /fenics_contact/.ci
COPY Makefile pyproject.toml README.md LICENSE LICENSE.GPL /fenics_contact/
COPY fenics_contact /fenics_contact/fenics_contact
COPY meshes /fenics_contact/meshes
COPY demos /fenics_contact/demos
COPY tests /fenics_contact/tests
WORKDIR /fenics_contact
RUN make setup && rm -rf /var/lib/apt/lists/*
CMD ["make", "demo"]
