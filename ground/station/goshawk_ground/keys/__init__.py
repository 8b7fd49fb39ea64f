"""Who may fly: the owner's own certificate authority, and the identities that it signs.

`names` says who there is, `authority` makes certificates, `identity` is one holder's folder, `keyring` the owner's
folder of folders. `parcel` carries an identity as a tar file, `pairing` over ssh. `goshawk keys` itself is in
`commands`, beside this room.
"""
