# The two commands of the README, in a bare Debian with Python:  docker build -t armwright . && docker run --rm armwright
ARG PYTHON=3.13
FROM python:${PYTHON}-slim-trixie
RUN apt-get update && apt-get install -y --no-install-recommends git make && rm -rf /var/lib/apt/lists/*
WORKDIR /armwright
COPY . .
RUN make demo
CMD ["make", "test"]
