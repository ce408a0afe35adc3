from readygo.services.coordinator.proofs import LeaseProofs


def test_proof_is_that_of_one_attempt_at_one_episode() -> None:
    proofs = LeaseProofs()
    proof = proofs.of(3, 1)
    assert proofs.proves(proof, 3, 1)
    assert not any(proofs.proves(proof, *other) for other in ((3, 2), (1, 3), (31, 1)))
    assert not any(proofs.proves(forged, 3, 1) for forged in ("", "\u00e9", proof.upper()))


def test_proof_of_an_earlier_process_is_none() -> None:
    assert not LeaseProofs().proves(LeaseProofs().of(3, 1), 3, 1)
