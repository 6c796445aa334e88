"""Proofs as their reader holds them: documents, words, and what is stated."""

import json
import pickle
from decimal import Decimal

from flint import ctx
from proofs import CONDITIONS

from orbits import prove
from orbits.io import to_json, unsealed


class TestDocuments:
    def test_the_document(self, cubic_proof, tmp_path):
        document = json.loads(to_json(cubic_proof.document()))
        assert document["proved"] is True
        assert document["alpha"] == {"low": cubic_proof.alpha.low, "high": cubic_proof.alpha.high}
        assert document["conditions"] == dict.fromkeys(document["conditions"], "proved")
        assert set(document["conditions"]) == CONDITIONS
        assert Decimal(document["radius"]) < Decimal("1e-18") < Decimal(document["uniqueness_radius"])
        assert unsealed(json.loads(cubic_proof.save(tmp_path / "proof.json").read_text(encoding="utf-8"))) == document

    def test_a_document_of_nothing(self, cubic_hop):
        proof = prove(cubic_hop, parameters={"beta": 3})
        document = json.loads(to_json(proof.document()))
        assert document["proved"] is False
        assert document["alpha"] is document["flight_time"] is document["contact_time"] is None
        assert "Nothing is proved" in proof.statement
        assert str(proof).startswith("NOT PROVED")

    def test_what_is_printed(self, cubic_proof):
        text = str(cubic_proof)
        assert text.startswith("proved\n")
        assert cubic_proof.alpha.low in text
        assert "beta = 0.3" in text
        assert "family 1" in text
        assert all(len(line) <= 120 for line in text.splitlines())
        assert "family=1" in repr(cubic_proof)

    def test_pickling(self, cubic_proof):
        assert pickle.loads(pickle.dumps(cubic_proof)) == cubic_proof

    def test_a_proof_that_is_asked_for_less_says_less(self, cubic_hop):
        proof = prove(cubic_hop, motion=False)
        assert proof.proved
        assert proof.family is None
        assert proof.contact_time is None
        assert not proof.conditions
        assert "motion" not in proof.statement

    def test_the_precision_of_arb_is_as_it_was(self, cubic_hop):
        before = ctx.prec, ctx.cap
        prove(cubic_hop, 30, motion=False)
        prove(cubic_hop, parameters={"beta": 3})
        assert (ctx.prec, ctx.cap) == before
