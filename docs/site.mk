# Pattern rules for a site of recordings: recording -> steady -> blackbox -> greybox -> validate, diagnose.
#
# A Makefile of your own includes this file and says what it wants:
#
#     SITE := $(wildcard site/*/*.steps.parquet)
#     all: $(SITE:.steps.parquet=.validate.yaml) $(SITE:.steps.parquet=.diagnose.yaml)
#     include site.mk
#
# NAME.steady.parquet, NAME.steps.parquet and NAME.holdout.parquet are recordings of one machine on one day. NAME may
# have folders in it, and no blanks. `make -j2` does two at a time, `make -k` goes on after a missed limit. diagnose
# does not wait for validate: it is wanted most where validate fails.

DRIVETOOL ?= drivetool
# Options of each step as they are typed, for example GREYBOX_OPTIONS := --map map.yaml --free all
STEADY_OPTIONS ?=
BLACKBOX_OPTIONS ?=
GREYBOX_OPTIONS ?=
VALIDATE_OPTIONS ?= --segment 1
DIAGNOSE_OPTIONS ?=

# The recordings are on the two cores already; threads of one fit would only get in each other's way.
export OPENBLAS_NUM_THREADS := 1
export OMP_NUM_THREADS := 1

%.steady.yaml: %.steady.parquet
	$(DRIVETOOL) steady $< $(STEADY_OPTIONS) --out $@ --quiet

%.blackbox.yaml: %.steps.parquet %.steady.yaml
	$(DRIVETOOL) blackbox $< --params $*.steady.yaml $(BLACKBOX_OPTIONS) --out $@ --quiet

%.greybox.yaml: %.steps.parquet %.steady.yaml %.blackbox.yaml
	$(DRIVETOOL) greybox $< --params $*.steady.yaml --params $*.blackbox.yaml $(GREYBOX_OPTIONS) --out $@ --quiet

%.validate.yaml: %.holdout.parquet %.greybox.yaml
	$(DRIVETOOL) validate $< --params $*.greybox.yaml $(VALIDATE_OPTIONS) --out $@ --quiet

%.diagnose.yaml: %.steps.parquet %.holdout.parquet %.greybox.yaml
	$(DRIVETOOL) diagnose $< --holdout $*.holdout.parquet --params $*.greybox.yaml $(DIAGNOSE_OPTIONS) --out $@ --quiet

# What lies between a recording and a verdict is kept.
.SECONDARY:
